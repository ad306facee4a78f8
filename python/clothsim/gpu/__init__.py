"""The compute shader: `backend="gpu"` of `step`, `simulate`, `Stepper` (docs/gpu.md).

One invocation is one mass point, in workgroups of 16 x 16 x 1; each RK4 stage is a dispatch. It
needs the extra "gpu" (wgpu) and a Vulkan, Metal or Direct3D 12 adapter. Mesa's lavapipe, which runs
shaders on the CPU, is enough. The first use of an adapter imports wgpu.
"""

from .device import adapters, using

__all__ = ["adapters", "using"]
