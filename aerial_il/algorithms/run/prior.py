"""A prior: a trained policy that a run starts from."""

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.policies import load_policy
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.tasks import tasks_of


def load_prior(source: str, spec: EnvSpec, *, key: str = "prior", alone: bool = False) -> ChunkPolicy:
    """Return a policy of any class that can fly in ``spec``; it decides by itself how often it plans.

    Args:
        source: folder of a run, a saved policy or one checkpoint. spec: of the environment it is to fly in.
        key: setting of the algorithm that named it. alone: whether its network learns on, which then must know this one
            task, as flights show no other's fields.

    Raises:
        CheckpointError: there is none, or what there is has been cut or altered.
        InvalidValueError: it was trained for another robot, task, action level or observation; names what differs.
    """
    policy = load_policy(source)
    try:
        policy.check(spec)
    except InvalidValueError as error:
        needed = f"one for {spec.task} on {spec.robot} with {spec.action.level} actions"
        raise InvalidValueError(
            f"The {key} {source} cannot fly here. {error} Give {needed}: algorithm.{key}=RUN."
        ) from error
    if alone and len(known := tasks_of(policy.spec)) > 1:
        raise InvalidValueError(
            f"The {key} {source} flies several tasks ({', '.join(known)}); its network cannot learn on in {spec.task} "
            f"alone. Give one of that task: algorithm.{key}=RUN."
        )
    return policy
