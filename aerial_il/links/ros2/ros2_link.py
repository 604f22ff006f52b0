"""A link to a robot over ROS 2: a client of whatever speaks as :mod:`robot_node` does, simulated or real.

It needs of a robot the topics ``description``, ``status``, ``observation`` and those of the images, ``set/action``, the
services of the orders and the parameters of their numbers.
"""

import atexit
import json
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from aerial_il.core.errors import AerialError, UnknownNameError
from aerial_il.core.specs import EnvSpec
from aerial_il.links.link import LinkError, Mode, Order, Reading, RefusedError
from aerial_il.links.ros2 import exact
from aerial_il.links.ros2.exact import NAMESPACE, NUMBERS
from aerial_il.links.ros2.middleware import Served, lasting, ros

PENDING = 5  # stamps of which something has arrived, and something has not


class Ros2Link:
    """A link, see :class:`aerial_il.links.link.Link`.

    Args:
        namespace: of the robot. level: of the actions in :attr:`spec`; :meth:`send` takes the others, too.
        timeout_s: how long the robot may take to be there, and to answer an order.

    Raises:
        LinkError: no robot is there, or two are, or it describes itself otherwise than ours.
        InvalidValueError: ROS 2 is not installed. UnknownNameError: the robot does not take the level.
    """

    lockstep = False

    def __init__(self, namespace: str = NAMESPACE, *, level: str | None = None, timeout_s: float = 10.0) -> None:
        self._namespace, self._timeout_s = namespace, timeout_s
        self._news = threading.Condition()
        self._described: str | None = None
        self._newest: Reading | None = None
        self._count = 0
        self._pending: OrderedDict[tuple[int, int], dict[str, Any]] = OrderedDict()
        self._problem: AerialError | None = None
        self._served = Served("link", namespace)
        self._node = self._served.node
        atexit.register(self.close)  # a script that ends without closing it would abort
        try:
            self._open(level)
        except BaseException:
            self._served.close()
            raise

    @property
    def spec(self) -> EnvSpec:
        """Fields of its readings, and the actions of the level that was asked for."""
        return self._spec

    @property
    def speed(self) -> float:
        """The robot's seconds in a second: 1 unless it is simulated otherwise."""
        return self._speed

    @property
    def levels(self) -> tuple[str, ...]:
        """Levels of the set points that the robot takes."""
        return tuple(self._actions)

    def read(self) -> Reading | None:
        """Return the newest reading that has arrived whole; ``told["received_s"]`` is when, by :func:`time.monotonic`.

        Raises:
            LinkError: what arrives is not what the robot described.
        """
        with self._news:
            if self._problem is not None:
                raise LinkError(f"The robot on {self._namespace}: {self._problem}") from self._problem
            return self._newest

    def send(self, level: str, action: np.ndarray) -> None:
        """Let the robot follow a set point (Da,) from now on.

        Raises:
            RefusedError: it is not finite, has another size, or the robot does not take the level.
        """
        if level not in self._actions:
            raise RefusedError(f"{self.spec.robot} takes no set points at {level!r}. Valid: {', '.join(self.levels)}.")
        action, spec = np.asarray(action, float), self._actions[level]
        if action.shape != (spec.size,):
            raise RefusedError(f"{level} takes {spec.size} numbers ({', '.join(spec.labels)}), got {action.shape}.")
        if not np.isfinite(action).all():
            raise RefusedError(f"{spec.labels[int(np.argmin(np.isfinite(action)))]} of the set point is not finite.")
        newest = self._newest
        self._send.publish(exact.named(0.0 if newest is None else newest.stamp_s, spec.labels, action))

    def order(self, order: Order, **numbers: float) -> None:
        """Give an order, and return when it was taken and :meth:`read` shows what came of it.

        Raises:
            RefusedError: the robot refuses it, and says why. LinkError: it does not answer.
        """
        order = Order(order)
        if order in NUMBERS:
            name, parameter = NUMBERS[order]
            if name in numbers:
                self._set_parameter(parameter, numbers[name])
        answer = self._answer(self._orders[order].call_async(ros().Trigger.Request()), order.value)
        if not answer.success:
            raise RefusedError(answer.message)
        self._await_readings(2)  # the first may have been on its way

    def step(self) -> None:
        """Wait for the next reading: the robot's time passes by itself.

        Raises:
            LinkError: none comes.
        """
        self._await_readings(1)

    def close(self) -> None:
        """Give up the link; a robot in the air hears no more, and hovers."""
        atexit.unregister(self.close)
        self._served.close()

    def _open(self, level: str | None) -> None:
        node = self._node
        node.create_subscription(ros().String, "description", self._take_description, lasting())
        self._send = node.create_publisher(ros().JointState, "set/action", 1)
        self._orders = {order: node.create_client(ros().Trigger, order.value) for order in Order}
        self._numbers = ros().AsyncParameterClient(node, f"{self._namespace}/robot")
        self._served.start()
        self._wait(lambda: self._described is not None, self._nobody)
        spec, self._actions, self._speed = _read_description(str(self._described), self._namespace)
        if level is not None and level not in self._actions:
            raise UnknownNameError("action level", level, self._actions)
        self._spec = replace(spec, action=self._actions[level or spec.action.level])
        self._subscribe()
        self._await_readings(1)
        for order, client in self._orders.items():
            self._wait(client.service_is_ready, self._robot(f"offered no service {order.value!r}"))
        self._wait(self._numbers.services_are_ready, self._robot("offered no parameters"))
        self._wait(self._send.get_subscription_count, self._robot("did not listen to 'set/action'"))
        if (count := node.count_publishers("description")) > 1:
            raise LinkError(f"{count} robots are on {self._namespace}. Give each a namespace: link.namespace=/NAME.")

    def _subscribe(self) -> None:
        images = self._spec.observation.of_group("image")
        self._wanted = {"status", "observation", *(field.name for field in images)}
        take, node = self._take, self._node
        node.create_subscription(ros().String, "status", partial(take, "status"), PENDING)
        node.create_subscription(ros().JointState, "observation", partial(take, "observation"), PENDING)
        for field in images:
            node.create_subscription(ros().Image, f"camera/{field.name}/image", partial(take, field.name), PENDING)

    def _take_description(self, message: Any) -> None:
        with self._news:
            self._described = message.data
            self._news.notify_all()

    def _take(self, name: str, message: Any) -> None:
        """Take a part of a reading, which is there when all parts of its stamp are."""
        try:
            with self._news:
                part = json.loads(message.data) if name == "status" else message
                at = exact.stamp(part["stamp_s"]) if name == "status" else message.header.stamp
                key = (at.sec, at.nanosec)
                parts = self._pending.setdefault(key, {})
                parts[name] = part
                if parts.keys() == self._wanted:
                    self._newest = self._whole(parts)
                    self._count += 1
                    while self._pending.popitem(last=False)[0] != key:
                        pass
                elif len(self._pending) > PENDING:
                    self._pending.popitem(last=False)
                self._news.notify_all()
        except (AerialError, LookupError, ValueError, TypeError, ArithmeticError, AssertionError) as error:
            self._problem = error if isinstance(error, AerialError) else LinkError(f"{name} is malformed: {error!r}")

    def _whole(self, parts: dict[str, Any]) -> Reading:
        status, spec = parts["status"], self._spec
        obs = exact.fields_of(parts["observation"], spec)
        for field in spec.observation.of_group("image"):
            obs[field.name] = exact.image_of(parts[field.name], field)
        told = {**status["told"], "refused": status["refused"], "received_s": time.monotonic()}
        return Reading(obs, status["stamp_s"], Mode(status["mode"]), status["armed"], told)

    def _await_readings(self, count: int) -> None:
        end = self._count + count
        self._wait(lambda: self._count >= end or self._problem is not None, self._robot("showed no whole reading"))
        self.read()

    def _set_parameter(self, name: str, value: float) -> None:
        value = int(value) if name == "seed" else float(value)
        answer = self._answer(self._numbers.set_parameters([ros().Parameter(name, value=value)]), name)
        if not answer.results[0].successful:
            raise RefusedError(f"{name}={value} is refused: {answer.results[0].reason}")

    def _answer(self, future: Any, what: str) -> Any:
        future.add_done_callback(lambda _: self._notify())
        self._wait(future.done, self._robot(f"did not answer {what!r}"))
        return future.result()

    def _notify(self) -> None:
        with self._news:
            self._news.notify_all()

    def _wait(self, seen: Callable[[], object], lacks: Callable[[], str]) -> None:
        """Wait for ``seen``, at most as long as was asked for; looks again by itself for what nobody notifies of."""
        end = time.monotonic() + self._timeout_s
        with self._news:
            while not seen():
                if time.monotonic() > end:
                    raise LinkError(f"In {self._timeout_s:g} s, {lacks()}")
                self._news.wait(0.05)

    def _robot(self, did: str) -> Callable[[], str]:
        return lambda: f"the robot on {self._namespace} {did}."

    def _nobody(self) -> str:
        topics = self._node.get_topic_names_and_types()
        others = sorted(name.removesuffix("/description") for name, _ in topics if name.endswith("/description"))
        others = [name for name in others if name != self._namespace]
        seen = f"Namespaces with robots: {', '.join(others)}." if others else "There is none on other namespaces."
        return (
            f"no robot described itself on {self._namespace}. {seen} Start one, with the same ROS_DOMAIN_ID: "
            f"aerial-il simulate link=ros2 link.namespace={self._namespace}"
        )


def _read_description(text: str, namespace: str) -> tuple[EnvSpec, dict[str, Any], float]:
    """Return the specification of a robot, its actions by their levels, and its speed."""
    try:
        raw = json.loads(text)
        spec = EnvSpec.from_dict(raw["spec"])
        speed = float(raw.get("speed", 1.0))
        specs = {level: EnvSpec.from_dict({**raw["spec"], "action": raw["actions"][level]}) for level in raw["actions"]}
    except (ValueError, KeyError, TypeError, AttributeError) as error:  # InvalidValueError is a ValueError
        raise LinkError(f"What is on {namespace} does not describe itself as a robot does: {error!r}.") from error
    return spec, {level: at.action for level, at in specs.items()}, speed
