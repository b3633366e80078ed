"""What may be asked of a bridge, by what it said of itself in its hello; refused here, nothing is sent."""

from __future__ import annotations

from surfuse.bridge.messages import Ability, ArmKind, Hello, MoveTo
from surfuse.errors import ConfigError, DeviceError, nearest


def check_sensors(hello: Hello, asked: tuple[str, ...], where: str) -> None:
    """Sensors that it has, each once.

    Raises
    ------
    ConfigError : otherwise.
    """
    for name in asked:
        if name not in hello.sensors:
            raise ConfigError(f"the bridge has no sensor '{name}'", where=where, cure=nearest(name, hello.sensors))
    if len(set(asked)) != len(asked):
        raise ConfigError("a sensor is asked twice in one sweep", where=where, cure="name each once")


def check_target(hello: Hello, to: MoveTo, where: str) -> None:
    """A target that fits its arm.

    Raises
    ------
    ConfigError : it moves nothing, or has other joints.
    """
    arm = hello.arm
    if arm is None:
        raise ConfigError("this bridge moves nothing ('arm' is null)", where=where, cure="record instead")
    if to.joints_rad is None:
        return
    if arm.kind is ArmKind.CARTESIAN or len(to.joints_rad) != arm.joints:
        has = "no joints to command" if arm.kind is ArmKind.CARTESIAN else f"{arm.joints} joints"
        raise ConfigError(f"a target of {len(to.joints_rad)} joints, the arm has {has}", where=where)


def demand(hello: Hello, ability: Ability, where: str) -> None:
    """An ability that it has announced.

    Raises
    ------
    DeviceError : it has not.
    """
    if ability not in hello.can:
        can = ", ".join(sorted(hello.can)) or "nothing of that kind"
        raise DeviceError(
            f"the bridge cannot '{ability.value}'; it can: {can}",
            where=where,
            cure=f"add '{ability.value}' to its 'can' and answer it",
        )
