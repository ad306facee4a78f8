"""The compute shader's speed beside the core's."""
