"""The contracts of policies by their former module name."""

from aerial_il.core.contracts import Observation, Policy, PrivilegedPolicy, SeededPolicy, attach

__all__ = ["Observation", "Policy", "PrivilegedPolicy", "SeededPolicy", "attach"]
