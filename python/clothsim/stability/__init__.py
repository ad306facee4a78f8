"""Which time steps are stable: predicted from the spectrum, and measured."""
