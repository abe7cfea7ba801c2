"""The control laws outside the engine's loop, for use as policies of an environment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drm_env import _engine
from drm_env._manoeuvres import law_json
from drm_env.configuration import ConfigLike, resolve_options
from drm_env.errors import ConfigError

if TYPE_CHECKING:
    from typing import Unpack

    from drm_env._options import Options

__all__ = ["ControlLaw"]

_TIP_RATE = "tip_turn_rate"
_INSTRUMENTS = ("link1_moment", "link2_moment", "tip_acceleration")


class ControlLaw:
    """A control law flown once per control period of a task.

    It is the engine's own law (the one behind ``inner_law`` and `drm_env.simulate`), evaluated for
    many environments at once.

    Parameters
    ----------
    law
        ``"none"``, ``"linear"``, ``"lyapunov"``, ``"servo"``, ``"collocated"`` or a mapping of a
        law's parameters.
    task, config, **options
        as for `DrmEnv`: the control period, the arm and the layout of the
        observation are read from them.

    Raises
    ------
    ConfigError
        an unknown name or an impossible value.

    Examples
    --------
    >>> import numpy as np
    >>> import drm_env
    >>> law = drm_env.ControlLaw({"name": "linear", "tip": None}, control_period=0.002)
    >>> seen = np.zeros((1, len(law.MEASUREMENTS)))
    >>> seen[0, law.MEASUREMENTS.index("slew_error")] = 0.01  # rad
    >>> torques, state = law.torques(seen, law.initial_state(1), [True])
    >>> torques[0].round(6).tolist()  # -8000 N m/rad at the root, a tip wheel that stays off
    [-80.0, 0.0]
    """

    MEASUREMENTS: tuple[str, ...] = tuple(_engine.measurement_names())
    """What a law is told, in the order of the columns of ``measurements``."""

    def __init__(
        self,
        law: Any = "linear",
        *,
        task: str = "slew",
        config: ConfigLike = None,
        **options: Unpack[Options],
    ) -> None:
        """Makes the law; see the class for the arguments."""
        resolved = resolve_options(task, config, options)
        self._law = _engine.Law(law_json(law), resolved.held)
        layout = resolved.observation_layout
        places = {entry.name: index for index, entry in enumerate(layout)}
        # an observation holds what instruments measure if it is asked to; few laws want the gyro
        unused = _INSTRUMENTS if self._law.needs_tip_rate else (_TIP_RATE, *_INSTRUMENTS)
        missing = [name for name in self.MEASUREMENTS if name not in places and name not in unused]
        self._missing = missing
        seen = [i for i, name in enumerate(self.MEASUREMENTS) if name in places]
        self._seen = np.array(seen, dtype=np.int64)
        self._columns = [places[self.MEASUREMENTS[i]] for i in seen]
        self._scales = np.array([layout[index].scale for index in self._columns])

    @property
    def control_period(self) -> float:
        """Time from one call to the next that the differences in the law assume, s."""
        return self._law.control_period

    @property
    def needs_tip_rate(self) -> bool:
        """Whether it feeds back ``tip_turn_rate``, of the gyro at the tip.

        Observations show it with ``observe_sensors=["tip_gyro"]``.
        """
        return self._law.needs_tip_rate

    @property
    def torque_limits(self) -> tuple[float, float]:
        """Limits of root and tip wheel, N m: an action is the torque divided by them."""
        return self._law.torque_limits

    def initial_state(self, n: int) -> NDArray[np.float64]:
        """The memory of ``n`` laws before their first call, shape (n, k), k numbers each."""
        return np.zeros((n, _engine.LAW_MEMORY))

    def measurements(self, observations: ArrayLike) -> NDArray[np.float64]:
        """SI values of the measured outputs and what is known, from observations.

        Parameters
        ----------
        observations
            shape (n, d), of an environment with this law's configuration.

        Returns
        -------
        measurements
            Shape (n, len(MEASUREMENTS)). Instruments that the observation does not show (see
            ``observe_sensors``) are 0: laws that want none of them do not look at them.

        Raises
        ------
        ConfigError
            the configuration's observation does not hold what a law needs.
        """
        if self._missing:
            raise ConfigError(
                f"the observation does not hold {self._missing[0]!r}, which a law needs"
            )
        values = np.asarray(observations, dtype=np.float64)[:, self._columns]
        measured = np.zeros((len(values), len(self.MEASUREMENTS)))
        measured[:, self._seen] = values * self._scales
        return measured

    def torques(
        self, measurements: ArrayLike, state: ArrayLike, start: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Wheel torques of one sample.

        Parameters
        ----------
        measurements
            shape (n, len(MEASUREMENTS)), SI, see `measurements`.
        state
            shape (n, k), what the call before returned.
        start
            shape (n,), true where an episode begins; the state is then ignored.

        Returns
        -------
        torques, state
            Torques of root and tip wheel before saturation, N m, shape (n, 2), and the new state.

        Raises
        ------
        SimulationError
            arrays whose shapes do not fit.
        """
        return self._law.torques(
            np.ascontiguousarray(measurements, dtype=np.float64),
            np.ascontiguousarray(state, dtype=np.float64),
            np.ascontiguousarray(start, dtype=np.bool_),
        )
