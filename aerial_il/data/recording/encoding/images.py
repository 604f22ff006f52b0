"""Camera images as compressed bytes: RGB as JPEG (lossy), depth and segmentation as 16-bit PNG.

Depth is kept in whole millimetres up to 65.535 m (0 where it is not finite or beyond), segmentation as id + 1 so that
the background, -1, becomes 0.
"""

import io

import numpy as np
from PIL import Image, UnidentifiedImageError

JPEG_QUALITY = 92
_MAX = np.iinfo(np.uint16).max


def encode(image: np.ndarray) -> bytes:
    """Compress one image: colours (H, W, 3) uint8, depth (H, W) in float metres, or segmentation (H, W) in int ids."""
    buffer = io.BytesIO()
    if image.dtype == np.uint8:
        Image.fromarray(image).save(buffer, "JPEG", quality=JPEG_QUALITY)
    else:
        Image.fromarray(whole_numbers(image)).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def decode(data: bytes, dtype: str, shape: tuple[int, ...]) -> np.ndarray:
    """Undo :func:`encode` for an image that was of this ``dtype`` and ``shape``.

    Raises:
        ValueError: the bytes are no such image, or one of another size; nothing is decompressed then.
    """
    try:
        image = Image.open(io.BytesIO(data), formats=("JPEG",) if dtype == "uint8" else ("PNG",))
        if (image.height, image.width) != shape[:2]:
            raise ValueError(f"image is {image.height} x {image.width}, not {shape[0]} x {shape[1]}")
        pixels = np.asarray(image)
    except (UnidentifiedImageError, OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"image cannot be decoded: {error}") from error
    if pixels.shape != shape:
        raise ValueError(f"image has shape {pixels.shape}, not {shape}")
    if dtype == "uint8":
        return pixels
    return pixels.astype(np.float32) / 1000 if np.dtype(dtype).kind == "f" else pixels.astype(np.int32) - 1


def whole_numbers(image: np.ndarray) -> np.ndarray:
    """Return depth (H, W) in mm, or ids + 1, as uint16."""
    if image.dtype.kind == "f":
        millimetres = np.round(np.nan_to_num(image, nan=0.0, posinf=0.0, neginf=0.0) * 1000)
        return np.where((millimetres >= 0) & (millimetres <= _MAX), millimetres, 0).astype(np.uint16)
    return np.clip(image.astype(np.int64) + 1, 0, _MAX).astype(np.uint16)
