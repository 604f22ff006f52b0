"""The suite in lerobot's programs: ``--env.discover_packages_path`` names this package; it registers ``aerial_il``."""
