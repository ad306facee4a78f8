"""Which time steps are stable: guaranteed, predicted from the spectrum, and measured."""
