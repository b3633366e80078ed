"""The twin's arm as a moving body: torques in, joint motion out, with dry friction that sticks, and brakes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surfuse.errors import ConfigError, DataError
from surfuse.geometry.compiled import compiled
from surfuse.motion.rigid_body import ArmDynamics
from surfuse.records import FloatArray
from surfuse.twin.dynamics.equations import Bodies, Frames, Scratch, motion_terms, scratch_of

_SWEEPS = 30
_STILL_RAD_S = 1e-9


@dataclass(frozen=True)
class PlantParameters:
    """How the arm is integrated and stopped.

    `substep_s`: step of the integration, in s. `brake_share`: friction of an applied brake as a share of the joint's
    largest torque. `braked`: which joints have one (on the PUMA 560 the first three). `end_stop_rad`: how far beyond
    the position limits the mechanical stops are, in rad.
    """

    substep_s: float = 2.5e-4
    brake_share: float = 1.0
    braked: tuple[bool, ...] = (True, True, True, False, False, False)
    end_stop_rad: float = 0.05

    def __post_init__(self) -> None:
        if not (np.isfinite(self.substep_s) and 0.0 < self.substep_s <= 1e-3):
            raise ConfigError(f"substep_s = {self.substep_s}", cure="give a time above 0, at most 1 ms")
        for name in ("brake_share", "end_stop_rad"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0.0):
                raise ConfigError(f"{name} = {getattr(self, name)}", cure="give 0 or more")


PlantMemory = tuple[
    tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, float],
    tuple[FloatArray, FloatArray, FloatArray],
    tuple[FloatArray, FloatArray],
    tuple[FloatArray, FloatArray, FloatArray],
    FloatArray,
    tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    tuple[FloatArray, FloatArray, FloatArray],
]
"""An arm of J joints as `integrate` takes it: links, losses, end stops, state (which moves on), room to work.

The links are the fields of `Bodies`. Losses: inertias of the motors (J,) in kg m^2, viscous friction (J,) in Nm s/rad,
dry friction forwards and backwards (2, J) in Nm, with the brakes. End stops: lowest and highest joint (J,) in rad.
State: joints (J,) in rad, speeds (J,) in rad/s, and the friction impulses (J,) in Nm s of the last step, from which the
next one starts. Room: matrices (5, J, J), the fields of `Frames`, and the rest of `Scratch`. Plain tuples, because they
are handed over at every tick: the names of NamedTuples cost microseconds.
"""


class ArmPlant:
    """An arm of J joints at rest at `start_rad` (J,); its brakes are applied until they are released.

    Semi-implicit Euler steps. Dry friction is solved together with the motion as a box-constrained problem for the
    friction impulses (projected Gauss-Seidel method: Jourdan, Alart and Jean, Computer Methods in Applied Mechanics
    and Engineering 155, 1998), so that a joint at rest stays at rest as long as friction can hold it.
    """

    def __init__(
        self,
        dynamics: ArmDynamics,
        start_rad: FloatArray,
        lower_rad: FloatArray,
        upper_rad: FloatArray,
        parameters: PlantParameters = PlantParameters(),
    ) -> None:
        joints = len(dynamics)
        if len(parameters.braked) != joints:
            raise ConfigError(f"braked names {len(parameters.braked)} joints, the arm has {joints}")
        self._dynamics = dynamics
        self._parameters = parameters
        self._low = np.asarray(lower_rad, dtype=np.float64) - parameters.end_stop_rad
        self._high = np.asarray(upper_rad, dtype=np.float64) + parameters.end_stop_rad
        self._brake = parameters.brake_share * dynamics.torque_max_nm * np.array(parameters.braked)
        self._position = np.empty(joints)
        self._velocity = np.zeros(joints)
        self._impulse = np.zeros(joints)
        # Attributes of the record are computed anew at every access; the loop needs them once.
        self._links = (
            dynamics.d_m,
            dynamics.a_m,
            dynamics.alpha_rad,
            dynamics.mass_kg,
            dynamics.center_m,
            dynamics.inertia_kg_m2,
            float(dynamics.gravity_m_s2),
        )
        self._losses = dynamics.armature_kg_m2, dynamics.viscous_nm_s
        scratch = scratch_of(joints)
        axis, origin, place, spun = scratch.frames
        self._matrices = np.empty((5, joints, joints))
        self._room = (axis, origin, place, spun), (scratch.forces, scratch.small, scratch.square)
        self.brakes_on = True
        self.rest_at(start_rad)

    @property
    def position_rad(self) -> FloatArray:
        """True joint positions (J,)."""
        return self._position.copy()

    @property
    def velocity_rad_s(self) -> FloatArray:
        """True joint speeds (J,)."""
        return self._velocity.copy()

    @property
    def brakes_on(self) -> bool:
        """Whether the brakes are applied."""
        return self._brakes_on

    @brakes_on.setter
    def brakes_on(self, applied: bool) -> None:
        self._brakes_on = applied
        dry: FloatArray = self._dynamics.coulomb_nm + (self._brake[:, None] if applied else 0.0)
        self._dry = np.ascontiguousarray(dry.T)

    def rest_at(self, position_rad: FloatArray) -> None:
        """Put the arm there, at rest, without history.

        `position_rad` (J,).

        Raises
        ------
        DataError : the position has another number of joints, or is not finite.
        """
        position = np.asarray(position_rad, dtype=np.float64)
        if position.shape != self._position.shape or not np.all(np.isfinite(position)):
            raise DataError(f"joint position {position.tolist()}, wanted {len(self._position)} finite angles")
        self._position[:] = position
        self.drift(np.zeros_like(position))

    def drift(self, velocity_rad_s: FloatArray) -> None:
        """Give the joints a speed (J,), as a blow would.

        In rad/s. The friction impulses of the last step are forgotten.
        """
        self._velocity[:] = velocity_rad_s
        self._impulse[:] = 0.0

    def step(self, torque_nm: FloatArray, duration_s: float) -> None:
        """Let joint torques (J,) act for a while.

        In Nm and s; the time is cut into equal steps of about `substep_s`.
        """
        steps = self.steps_in(duration_s)
        integrate(self.memory, torque_nm, duration_s / steps, steps)

    def steps_in(self, duration_s: float) -> int:
        """Number of integration steps in a time."""
        return max(1, round(duration_s / self._parameters.substep_s))

    @property
    def memory(self) -> PlantMemory:
        """What `integrate` takes first; valid until the brakes are applied or released."""
        state = self._position, self._velocity, self._impulse
        losses = *self._losses, self._dry
        return self._links, losses, (self._low, self._high), state, self._matrices, *self._room


@compiled
def integrate(plant: PlantMemory, torque: FloatArray, h: float, steps: int) -> None:
    """Let joint torques (J,) in Nm act for some steps of length h (s); see `ArmPlant`."""
    (d, a, alpha, mass, center, inertia, gravity), losses, (low, high), (q, qd, impulse), matrices, where, room = plant
    bodies = Bodies(d, a, alpha, mass, center, inertia, gravity)
    scratch = Scratch(Frames(where[0], where[1], where[2], where[3]), room[0], room[1], room[2])
    armature, viscous, dry = losses
    forwards, backwards = dry[0], dry[1]
    n = q.shape[0]
    matrix, mobility, lower, bias, momentum = matrices[0], matrices[1], matrices[2], matrices[3, 0], matrices[4, 0]
    for _ in range(steps):
        motion_terms(bodies, q, qd, matrix, bias, scratch)
        for i in range(n):
            matrix[i, i] += armature[i]
            momentum[i] = h * (torque[i] - bias[i])
            for j in range(n):
                momentum[i] += matrix[i, j] * qd[j]
        for i in range(n):
            # Viscous friction is taken at the end of the step, which keeps any step length stable.
            matrix[i, i] += h * viscous[i]
        _inverse(matrix, mobility, lower)
        for i in range(n):
            qd[i] = 0.0
            for j in range(n):
                qd[i] += mobility[i, j] * (momentum[j] + impulse[j])
        _stick(mobility, h, forwards, backwards, qd, impulse)
        for i in range(n):
            q[i] += h * qd[i]
            if (q[i] <= low[i] and qd[i] < 0.0) or (q[i] >= high[i] and qd[i] > 0.0):
                q[i] = min(max(q[i], low[i]), high[i])
                qd[i] = 0.0


@compiled
def _inverse(matrix: FloatArray, result: FloatArray, lower: FloatArray) -> None:
    """Inverse of a small symmetric positive definite matrix by Cholesky's method; `lower` (J, J) is room to work."""
    n = matrix.shape[0]
    for j in range(n):
        for i in range(j, n):
            total = matrix[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            lower[i, j] = np.sqrt(total) if i == j else total / lower[j, j]
    # Invert the triangle in place, then multiply it with its transpose.
    for j in range(n):
        lower[j, j] = 1.0 / lower[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= lower[i, k] * lower[k, j]
            lower[i, j] = total / lower[i, i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += lower[k, i] * lower[k, j]
            result[i, j] = total
            result[j, i] = total


@compiled
def _stick(
    mobility: FloatArray,
    h: float,
    forwards: FloatArray,
    backwards: FloatArray,
    qd: FloatArray,
    impulse: FloatArray,
) -> None:
    """Find the friction impulses that oppose the motion, and the speeds under them; both are updated in place.

    `mobility` (J, J) in 1/(kg m^2), `forwards` and `backwards` (J,) the largest friction in Nm, `qd` and `impulse`
    (J,).
    """
    n = qd.shape[0]
    for _ in range(_SWEEPS):
        largest = 0.0
        for j in range(n):
            wanted = impulse[j] - qd[j] / mobility[j, j]
            wanted = min(max(wanted, -h * forwards[j]), h * backwards[j])
            change = wanted - impulse[j]
            if change == 0.0:
                continue
            impulse[j] = wanted
            largest = max(largest, abs(change) * mobility[j, j])
            for i in range(n):
                qd[i] += mobility[i, j] * change
        if largest < _STILL_RAD_S:
            return
