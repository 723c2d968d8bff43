"""A soft body in MuJoCo: its flex elasticity, its contacts with the table and with pressing hands, its steps."""

from types import ModuleType
from typing import Any

import numpy as np

from egophys_core.constants import GRAVITY
from egophys_core.errors import EgophysError, SimulationError
from egophys_core.rehearsal.bodies import SKIN, SoftBody

AIR_DAMPING = 0.5
"""1/s: force over mass and velocity."""

SETTLING_DAMPING = 20.0
"""1/s, while the body comes to rest before an episode."""

HAND_RADIUS = 0.03
"""Metres, of the ball that presses."""


def load_mujoco() -> ModuleType:
    """The package, when it is needed.

    Raises:
        EgophysError: it is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        raise EgophysError(
            "rehearsing needs the package mujoco, which is not installed: pip install egophys[rehearsal]"
        ) from error
    # By default MuJoCo writes its warnings to a file where it is run; `FlexEngine.step` says what diverged.
    mujoco.set_mju_user_warning(lambda message: None)
    return mujoco


class FlexEngine:
    """One body, one table, and as many pressing balls as asked for."""

    def __init__(self, body: SoftBody, *, step: float, pressing: int, folding: bool) -> None:
        self._mujoco = load_mujoco()
        self._model: Any = self._mujoco.MjModel.from_xml_string(_scene(body, step, pressing, folding))
        self._data: Any = self._mujoco.MjData(self._model)
        _vary_stiffness(self._model, body)
        self._mujoco.mj_forward(self._model, self._data)
        self._bodies = self._model.flex_vertbodyid
        self._start = self._data.flexvert_xpos.copy()
        # Each vertex has three sliding joints along the world's axes; the balls' joints come after them.
        coordinates = self._start.size
        self._displacements = self._data.qpos[:coordinates].reshape(-1, 3)
        self._ball_places = self._data.qpos[coordinates:].reshape(-1, 3)
        self._ball_velocities = self._data.qvel[coordinates:].reshape(-1, 3)
        self.velocities: np.ndarray = self._data.qvel[:coordinates].reshape(-1, 3)
        """[V, 3] m/s, a view that follows the steps."""
        self.forces: np.ndarray = self._data.qfrc_applied[:coordinates].reshape(-1, 3)
        """[V, 3] N, applied in the next step; the caller sets them anew for every step."""
        self.edges: np.ndarray = self._model.flex_edge
        """[E, 2] vertex indices."""
        self.edge_rest_lengths: np.ndarray = self._model.flexedge_length0
        """[E] metres; writing into it changes the shape that the elasticity returns to."""
        self.set_damping(AIR_DAMPING)

    @property
    def positions(self) -> np.ndarray:
        """[V, 3] metres, a new array."""
        return self._start + self._displacements

    @property
    def masses(self) -> np.ndarray:
        """[V] kg."""
        return self._model.body_mass[self._bodies]

    def set_masses(self, masses: np.ndarray) -> None:
        """Give the vertices new masses [V], kg."""
        share = masses / self.masses
        self._model.body_mass[self._bodies] = masses
        self._model.body_inertia[self._bodies] *= share[:, None]
        self._mujoco.mj_setConst(self._model, self._data)
        self.set_damping(AIR_DAMPING)

    def set_gravity(self, gravity: np.ndarray) -> None:
        """Set the acceleration [3] m/s^2."""
        self._model.opt.gravity[:] = gravity

    def set_friction(self, coefficient: float) -> None:
        """Set the Coulomb coefficient between body and table."""
        self._model.geom_friction[:, 0] = coefficient
        self._model.flex_friction[:, 0] = coefficient

    def set_damping(self, rate: float) -> None:
        """Set the damping, 1/s, of all motion."""
        self._model.dof_damping[: self._start.size] = rate * np.repeat(self.masses, 3)

    def stop(self) -> None:
        """Take all velocity away and start the clock at zero."""
        self.velocities[:] = 0.0
        self._data.time = 0.0

    def place_balls(self, centres: np.ndarray, velocities: np.ndarray) -> None:
        """Put the pressing balls at `centres` [pressing, 3] metres, moving with `velocities` m/s."""
        self._ball_places[:] = centres
        self._ball_velocities[:] = velocities

    def table_pressures(self) -> np.ndarray:
        """[V] N: with how much force the table held each vertex up in the last step."""
        contacts = self._data.contact
        on_table = (contacts.geom[:, 0] == 0) & (contacts.vert[:, 1] >= 0) & (contacts.efc_address >= 0)
        forces = np.zeros(len(self._start))
        # Elliptic cone: the first row of a contact is its normal force.
        np.add.at(forces, contacts.vert[on_table, 1], self._data.efc_force[contacts.efc_address[on_table]])
        return forces

    def step(self) -> None:
        """Advance by one step.

        Raises:
            SimulationError: the step diverged.
        """
        time = self._data.time
        self._mujoco.mj_step(self._model, self._data)
        # MuJoCo answers a state that is not finite by a reset, which turns the clock back.
        if self._data.time <= time:
            raise SimulationError(
                f"the rehearsed body diverged at t={time:.3f} s; inject a smaller effect, or another object seed"
            )


def _vary_stiffness(model: Any, body: SoftBody) -> None:
    """Scale the elasticity of each element, and the bending at each edge by the mean of the elements beside it."""
    model.flex_stiffness *= body.stiffness_shares[:, None]
    if not body.is_sheet:
        return
    count = len(body.vertices)
    sides = np.sort(np.concatenate([body.elements[:, list(pair)] for pair in ((0, 1), (1, 2), (0, 2))]), axis=1)
    keys = sides[:, 0] * count + sides[:, 1]
    sums, counts = (np.bincount(keys, weights, count**2) for weights in (np.tile(body.stiffness_shares, 3), None))
    edges = np.sort(model.flex_edge, axis=1)
    at = edges[:, 0] * count + edges[:, 1]
    model.flex_bending *= (sums[at] / counts[at])[:, None]


def _scene(body: SoftBody, step: float, pressing: int, folding: bool) -> str:
    """The scene in MuJoCo's format."""
    points = " ".join(f"{value:.9g}" for value in body.vertices.ravel())
    elements = " ".join(str(value) for value in body.elements.ravel())
    shell = f'thickness="{body.thickness}" elastic2d="both"' if body.is_sheet else ""
    friction = f"{body.friction} 0.005 0.0001"
    layers = "sap" if folding and body.is_sheet else "none"
    # A ball too heavy for the body to disturb: a kinematic one would be at rest to friction. It passes the table.
    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    ball = f'<geom type="sphere" size="{HAND_RADIUS}" mass="100" friction="{friction}" contype="2" conaffinity="2"/>'
    balls = f'<body gravcomp="1">{slides}{ball}</body>' * pressing
    return f"""<mujoco>
<option timestep="{step}" solver="CG" integrator="Euler" cone="elliptic" jacobian="sparse" tolerance="1e-6"
        iterations="20" gravity="0 0 {-GRAVITY}"/>
<size memory="200M"/>
<worldbody>
<geom name="table" type="plane" size="5 5 0.1" friction="{friction}" solref="0.01 1"/>
<flexcomp name="body" type="direct" dim="{body.elements.shape[1] - 1}" radius="{SKIN}" mass="{body.mass}"
          point="{points}" element="{elements}">
<contact selfcollide="{layers}" internal="false" contype="3" conaffinity="3" friction="{friction}" solref="0.01 1"/>
<edge damping="0"/>
<elasticity young="{body.young}" poisson="{body.poisson}" damping="{body.damping}" {shell}/>
</flexcomp>
{balls}
</worldbody>
</mujoco>"""
