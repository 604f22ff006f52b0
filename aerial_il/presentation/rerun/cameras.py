"""Recorded pictures, each in the frustum of the camera that took it."""

import mujoco
import numpy as np
import rerun as rr

from aerial_il.data.episode import Episode
from aerial_il.data.recording.encoding.images import encode
from aerial_il.presentation.rerun.log import Log
from aerial_il.presentation.rerun.motion import Motion, recorded_cameras
from aerial_il.presentation.rerun.scene import xyzw

FRUSTUM_M = 0.08  # from the camera to its picture in the scene
UNITS_PER_METRE = 1000.0  # of recorded depth: millimetres


def log_cameras(log: Log, episode: Episode, motion: Motion) -> None:
    """Log every camera whose pictures were recorded."""
    for field, camera, focal in recorded_cameras(episode, motion.model):
        _log_frustum(log, f"cameras/{field}", motion, camera, focal, episode.obs[field].shape[1:3])
        log_pictures(log, f"cameras/{field}", episode.obs[field])


def _log_frustum(log: Log, entity: str, motion: Motion, camera: int, focal: float, size: tuple[int, ...]) -> None:
    height, width = size
    view = rr.Pinhole(
        focal_length=focal,
        width=width,
        height=height,
        camera_xyz=rr.ViewCoordinates.RUB,  # MuJoCo's cameras look along -z
        image_plane_distance=FRUSTUM_M,
    )
    log.static(entity, view)
    poses = motion.camera_pos[:, camera], motion.camera_mat[:, camera]
    if not np.ptp(poses[0], axis=0).any() and not np.ptp(poses[1], axis=0).any():
        log.static(entity, rr.Transform3D(translation=poses[0][0], mat3x3=poses[1][0]))
        return
    quats = np.zeros((len(motion), 4))
    for quat, mat in zip(quats, poses[1].reshape(-1, 9), strict=True):
        mujoco.mju_mat2Quat(quat, mat)
    log.send(entity, rr.Transform3D.columns(translation=poses[0], quaternion=xyzw(quats)))


def log_pictures(log: Log, entity: str, pictures: np.ndarray) -> None:
    """Log pictures (N, H, W[, 3]): colours (uint8) as JPEG, depth (floats) in mm and segmentation by id as PNG."""
    colours = pictures.dtype == np.uint8
    kind, media = (rr.EncodedImage, "image/jpeg") if colours else (rr.EncodedDepthImage, "image/png")
    if not colours:
        log.static(entity, rr.EncodedDepthImage.from_fields(meter=UNITS_PER_METRE))
    log.send(entity, kind.columns(blob=[*map(encode, pictures)], media_type=[media] * len(pictures)))
