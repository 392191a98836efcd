"""The nodes of the control loop and what they share."""
