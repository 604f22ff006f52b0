"""Derive another form of recordings: LeRobot v3, robomimic's or D4RL's HDF5, Minari, files for rerun, Foxglove.

The form is that of the ending of out=: .hdf5 is robomimic's, .rrd is rerun's, .mcap is one flight for ROS 2's viewers,
a folder is LeRobot's; format= says otherwise. A dataset of Minari's is a folder named NAME-vN. Every recorded camera
becomes a video, or images. An up-to-date LeRobot dataset is left as it is.

Example: aerial-il convert datasets/pick
Example: aerial-il convert datasets/pick cameras=[wrist] out=datasets/pick_wrist
Example: aerial-il convert datasets/pick out=pick.hdf5
Example: aerial-il convert datasets/pick format=d4rl out=pick_flat.hdf5
Example: aerial-il convert datasets/pick format=minari out=pick-v0
Example: aerial-il convert datasets/pick format=mcap
"""

from aerial_il.workflows.convert import Convert, convert

SETTINGS, BARE = Convert, ("path",)
VIEWS = "For Foxglove, RViz and rerun"


def run(settings: Convert) -> None:
    """Convert, and say where the result lies."""
    print(f"{VIEWS if settings.form == 'mcap' else settings.form}: {convert(settings)}")
