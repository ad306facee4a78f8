"""From a scene to stepping arrays: plan, state, steps, snapshots, integrators."""
