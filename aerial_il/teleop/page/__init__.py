"""The page to fly on, as files that a browser reads as they are: no build, nothing from elsewhere."""

from pathlib import Path

PAGE = Path(__file__).parent
