"""The node that commissions an axis: a thin one over the room `tcs_friction.commissioning`."""
