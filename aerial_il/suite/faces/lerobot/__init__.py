"""The suite in lerobot's programs: ``--env.discover_packages_path`` names this package, which registers ``aerial_il``."""
