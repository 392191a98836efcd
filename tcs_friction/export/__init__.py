"""Back to where people work: an axis in their simulator, drive or firmware. One file for each format behind `formats`."""
