"""Off-screen buffers of our own beside MuJoCo's: without samples for labels, slim for pictures.

MuJoCo's buffer has 64 bits of depth and stencil a sample, all of which a software renderer has to
clear and test; the stencil serves mirrors that no scene has. Depth alone draws a multisampled
frame in 14 % less time, bit for bit the same. One context with two targets also holds textures
and meshes once, where two contexts hold them twice.
"""

from types import TracebackType
from typing import Self

import mujoco

from sim.gl import GraphicsError


class Target:
    """A frame buffer; inside its `with` block MuJoCo draws there instead of into its own."""

    def __init__(self, context: mujoco.MjrContext, samples: int) -> None:
        """Allocate colour and depth of the context's off-screen size.

        Args:
            context: Current.
            samples: Colour samples a pixel; 0 or the context's own number.

        Raises:
            GraphicsError: If the driver cannot.
        """
        from OpenGL import GL  # binds to the backend that is open

        self._gl = GL
        self._context = context
        self._samples = samples
        size = context.offWidth, context.offHeight
        self._buffers = GL.glGenRenderbuffers(2)
        self._frame = int(GL.glGenFramebuffers(1))
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._frame)
        for buffer, storage, attachment in zip(
            self._buffers,
            (GL.GL_RGBA8, GL.GL_DEPTH_COMPONENT32F),
            (GL.GL_COLOR_ATTACHMENT0, GL.GL_DEPTH_ATTACHMENT),
            strict=True,
        ):
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            GL.glRenderbufferStorageMultisample(GL.GL_RENDERBUFFER, samples, storage, *size)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, attachment, GL.GL_RENDERBUFFER, buffer)
        complete = GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) == GL.GL_FRAMEBUFFER_COMPLETE
        if not complete:
            raise GraphicsError(f"no frame buffer of {size[0]}x{size[1]} px")

    def __enter__(self) -> Self:
        self._own = self._context.offFBO, self._context.offSamples
        self._context.offFBO, self._context.offSamples = self._frame, self._samples
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        self._context.offFBO, self._context.offSamples = self._own

    def free(self) -> None:
        """Release the memory; the context must be current."""
        self._gl.glDeleteFramebuffers(1, [self._frame])
        self._gl.glDeleteRenderbuffers(2, self._buffers)
