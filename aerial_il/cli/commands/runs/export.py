"""Write a policy as an ONNX graph with all around it: it flies with NumPy and onnxruntime, without torch or MuJoCo.

The folder has network.onnx, exported.json and a README with robot, task, observations, success and origin. It flies by
aerial-il evaluate policy=FOLDER, and anywhere by aerial_il.load_policy("FOLDER").

Example: aerial-il export policy=runs/pick out=exported/pick
Example: aerial-il evaluate policy=exported/pick out=exported/evaluation episodes=50
"""

from aerial_il.workflows.export import Export, export

SETTINGS, BARE = Export, ("policy",)


def run(settings: Export) -> None:
    """Export, and say what is where."""
    made = export(settings)
    print(
        f"Policy: {made.folder} ({made.graph_bytes / 1e6:.1f} MB), within {made.difference:.1g} of the network in "
        f"normalised actions\nFly it: aerial-il evaluate policy={made.folder} out={made.folder}-evaluation"
    )
