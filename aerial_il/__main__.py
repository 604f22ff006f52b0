"""``python -m aerial_il`` is the command ``aerial-il``."""

from __future__ import annotations

import sys

from aerial_il.cli.main import main

sys.exit(main())
