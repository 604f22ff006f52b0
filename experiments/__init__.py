"""Studies: a folder each, with question and answer (``README.md``), all numbers, and ``study.py``, which measures them.

``aerial-il bench NAME`` runs one from a checkout, ``aerial-il bench`` all; ``common/`` holds what several share. They
may import all of the package; nothing of it imports them, and an installed wheel has none.
"""
