"""Conditioning: what every analysis does to recordings first: even time steps, timing of the torque, bands, filters, noise."""
