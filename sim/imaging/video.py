"""What remains of a camera's images after H.264, the compression of video."""

from fractions import Fraction
from typing import Any

import cv2
import numpy as np

from vo.contract.arrays import Image
from vo.contract.errors import SettingsError

KEYFRAME_EVERY = 30
"""Frames from one that is compressed by itself to the next."""
SPEED = {"preset": "veryfast", "tune": "zerolatency"}
"""x264's choices that come near to an encoder in a camera: one pass, no frame waits for others."""


class Video:
    """H.264 stream of one camera: an encoder and the decoder at its other end.

    One thread each, so that equal images give equal bytes.
    """

    def __init__(self, crf: int) -> None:
        """Prepare a stream of a constant quality: 1 is nearly lossless, 51 the worst.

        Raises:
            SettingsError: If PyAV is not installed.
        """
        try:
            import av
        except ImportError:
            raise SettingsError(
                f"sensor.h264_crf = {crf} needs the package av: pip install 'driftyard[video]'"
            ) from None
        self._av: Any = av
        self._crf = crf
        self._codecs: tuple[Any, Any] | None = None
        self._count = 0

    def through(self, image: Image) -> Image:
        """Compress the next image of the stream, (H, W) or (H, W, 3) uint8, and return the rest.

        Colours pass as 4:2:0 of BT.601 with levels from 16 to 235, grey images with all levels.
        """
        height, width = image.shape[:2]
        even = cv2.copyMakeBorder(image, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
        planes = even if image.ndim == 2 else cv2.cvtColor(even, cv2.COLOR_RGB2YUV_I420)
        form = "gray" if image.ndim == 2 else "yuv420p"
        if self._codecs is None:
            self._codecs = self._open(even.shape[1], even.shape[0], form)
        encoder, decoder = self._codecs
        frame = self._av.VideoFrame.from_ndarray(planes, format=form)
        frame.pts = self._count
        self._count += 1
        (packet,) = encoder.encode(frame)
        (decoded,) = decoder.decode(packet)
        found = np.asarray(decoded.to_ndarray(), np.uint8)
        # A grey image may come back with planes of no colour below it.
        rest = found if image.ndim == 2 else cv2.cvtColor(found, cv2.COLOR_YUV2RGB_I420)
        return np.ascontiguousarray(rest[:height, :width], np.uint8)

    def _open(self, width: int, height: int, form: str) -> tuple[Any, Any]:
        encoder = self._av.CodecContext.create("libx264", "w")
        encoder.width, encoder.height, encoder.pix_fmt = width, height, form
        encoder.time_base = Fraction(1, KEYFRAME_EVERY)
        every = str(KEYFRAME_EVERY)
        keyframes = {"g": every, "keyint_min": every, "sc_threshold": "0"}
        encoder.options = {"crf": str(self._crf), **SPEED, **keyframes}
        decoder = self._av.CodecContext.create("h264", "r")
        encoder.thread_count = decoder.thread_count = 1
        return encoder, decoder
