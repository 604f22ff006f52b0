"""The Python reference: what scripts call, and what an extension is made of, from the docstrings of these modules."""

from aerial_il.presentation.markdown import table

FRONT = "aerial_il"
SHOWN = {  # module -> what a reader finds there; everything else is read in its file
    FRONT: "what scripts call; stays from version to version",
    "aerial_il.core.contracts": "what an environment, a policy, an expert and an algorithm are",
    "aerial_il.core.specs": "what observations and actions are: names, shapes, units, bounds",
    "aerial_il.suite.environment": "one world, a `dm_control` environment",
    "aerial_il.suite.batch": "many worlds, stepped together",
    "aerial_il.suite.tasks.task": "what a task defines",
    "aerial_il.robots.robot": "what a robot defines",
    "aerial_il.experts.expert": "what a scripted expert defines",
    "aerial_il.data.dataset": "a folder or file of demonstrations",
    "aerial_il.data.episode": "one flight as arrays",
}
AUTOMODULE = "{0}\n{1}\n\n.. automodule:: {0}\n   :members:\n"
INTRODUCTION = """\
# Python reference

What scripts may rely on, and what extensions are made of, from the docstrings. [In Python](../python.md) it is in use.
All other modules explain themselves in their files: [architecture](../architecture.md) says where to look."""


def pages() -> dict[str, str]:
    """Return path on the site -> text: a page for each module, and a list of them."""
    rows = [(f"[`{name}`]({name}.rst)", what) for name, what in SHOWN.items()]
    index = f"{INTRODUCTION}\n\n{table(('module', ''), rows)}\n"
    return {
        "python/index.md": index,
        **{f"python/{name}.rst": AUTOMODULE.format(name, "=" * len(name)) for name in SHOWN},
    }
