"""How good demonstrations are, each judged alone or against the others of its dataset.

:func:`.judge.judge` reads a dataset once and gives each episode a number for each measure, and the reason why it is
suspect, if it is. A measure is a file of this folder.
"""
