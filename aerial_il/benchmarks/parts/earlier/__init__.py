"""Earlier commits of this package, run beside the present one."""
