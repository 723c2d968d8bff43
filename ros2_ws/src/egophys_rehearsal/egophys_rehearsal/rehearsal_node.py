"""rehearsal_node: a soft object in MuJoCo, handled by the arm or by scripted hands, seen with noise."""

import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from egophys_ros_common import names
from egophys_ros_common.conversions import points_message, time_message
from egophys_ros_common.managed_node import ManagedNode
from egophys_ros_common.parameters import (
    declare_names,
    declare_number,
    declare_options,
    declare_texts,
    read_options,
)
from egophys_ros_common.qos import latched
from egophys_ros_common.running import run_node
from egophys_ros_common.worker import CanceledError, Worker
from geometry_msgs.msg import PoseStamped
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from egophys_core.errors import OptionsError
from egophys_core.rehearsal import Motion, RehearsalOptions
from egophys_core.rehearsal.engine import load_mujoco
from egophys_core.rehearsal.hands import hand_cloud
from egophys_core.rehearsal.observation import CONFIDENCE
from egophys_rehearsal.arm_stage import ArmStage
from egophys_rehearsal.frame import RehearsalFrame, Stage
from egophys_rehearsal.injection import injected_effects
from egophys_rehearsal.script_stage import ScriptStage
from egophys_rehearsal.tool_track import ToolTrack

ARM = "arm"
TEXT_PARAMETERS = {
    "hands": (ARM, f"who handles the object: {ARM}, or scripted hands: {', '.join(Motion)}"),
    "effects": ("none", "names of the effects to inject, separated by spaces; none for none"),
    "effect_size": ("large", "size of the effects: small or large"),
    "effect_parameters": ("", 'parameters in place of the size\'s, JSON: {"control_delay": {"delay": 0.1}}; SI units'),
}
TOPIC_PARAMETERS = {
    "tool_pose_topic": (names.TOOL_POSE, "topic of the measured tool pose (geometry_msgs/PoseStamped)"),
    "gripper_topic": (names.GRIPPER_COMMAND, "topic of the commanded opening (std_msgs/Float64, m)"),
    "object_topic": (names.OBJECT_POINTS, "topic to publish the object's points on"),
    "controller_topic": (names.CONTROLLER_POINTS, "topic to publish the points of the tool or the hands on"),
}
SEED_PARAMETERS = {
    "seed": "seed of noise, dropouts and scripted motions",
    "object_seed": "seed of the object: size, mass, stiffness, friction",
}


class RehearsalNode(ManagedNode):
    """Shows frame after frame of a stage, which a worker thread makes."""

    def __init__(self) -> None:
        """Declare the parameters: those of the node and every option of the rehearsal."""
        super().__init__("rehearsal_node")
        declare_texts(self, TEXT_PARAMETERS)
        declare_names(self, TOPIC_PARAMETERS)
        for name, description in SEED_PARAMETERS.items():
            declare_number(self, name, 0, low=0, high=2**31 - 1, doc=description)
        doc = "opening below which the gripper holds what is near it, m"
        declare_number(self, "closed_below_m", 0.02, low=0.0, high=0.2, doc=doc)
        declare_options(self, RehearsalOptions)
        self._worker: Worker
        self._track: ToolTrack
        self._make: Callable[[], Stage]
        self._stage: Stage | None = None
        self._is_busy = False
        self._problem = ""

    def configure(self) -> None:
        """Check the parameters and create topics and the service."""
        load_mujoco()
        options = read_options(self, RehearsalOptions)
        self._track = ToolTrack(closed_below=self.get_parameter("closed_below_m").value)
        self._make = self._stage_maker(options)
        self._worker = self.own(Worker("rehearse", self.hand_over), Worker.close)
        self._objects, self._controllers = (
            self.own(
                self.create_publisher(PointCloud2, self.get_parameter(name).value, qos_profile_sensor_data),
                self.destroy_publisher,
            )
            for name in ("object_topic", "controller_topic")
        )
        for kind, name, callback, qos in (
            (PoseStamped, "tool_pose_topic", self._take_pose, qos_profile_sensor_data),
            (Float64, "gripper_topic", self._take_opening, latched()),
        ):
            subscription = self.create_subscription(kind, self.get_parameter(name).value, callback, qos)
            self.own(subscription, self.destroy_subscription)
        waiting = ReentrantCallbackGroup()
        timer = self.create_timer(0.5 / options.rate_hz, self._show, callback_group=waiting)
        self.own(timer, self.destroy_timer)
        self.own(self.create_service(Trigger, "~/reset", self._reset, callback_group=waiting), self.destroy_service)

    def activate(self) -> None:
        """Lay the object on the table."""
        self._problem = ""
        self.executor.create_task(self._begin)

    def deactivate(self) -> None:
        """Finish the frame that is made."""
        self._worker.stop()
        self._stage = None

    def status(self) -> str:
        """What is done, or waited for."""
        if not self.is_active:
            return super().status()
        return self._stage.status(self._now_ns()) if self._stage else "the object is being laid on the table"

    def fault(self) -> str:
        """Why nothing is shown, until someone calls `~/reset`."""
        return self._problem if self.is_active else ""

    def _stage_maker(self, options: RehearsalOptions) -> Callable[[], Stage]:
        hands = self.get_parameter("hands").value
        if hands not in (ARM, *Motion):
            raise OptionsError(f"hands must be one of {ARM}, {', '.join(Motion)}, got {hands!r}")
        effects = injected_effects(
            self.get_parameter("effects").value,
            size=self.get_parameter("effect_size").value,
            parameters_json=self.get_parameter("effect_parameters").value,
        )
        seed, object_seed = (self.get_parameter(name).value for name in SEED_PARAMETERS)
        if hands != ARM:
            return partial(ScriptStage, options, Motion(hands), seed=seed, object_seed=object_seed, effects=effects)
        cloud = hand_cloud(1, np.random.default_rng(seed))[0]
        return partial(
            ArmStage,
            options,
            seed=seed,
            object_seed=object_seed,
            effects=effects,
            track=self._track,
            cloud=cloud - cloud.mean(axis=0),
        )

    async def _begin(self) -> bool:
        """Begin anew, with the gripper open; whether it worked."""
        self._stage = None
        try:
            stage = await self._worker.run(self._make)
        except CanceledError:
            return False
        except Exception as error:
            self._problem = self.refuse("cannot rehearse", error)
            return False
        self._track.open()
        self._stage, self._problem, self.last_error = stage, "", ""
        return True

    async def _show(self) -> None:
        """Show the frames that are due, one after another."""
        if self._is_busy:
            return
        self._is_busy = True
        stage = self._stage
        try:
            while self.is_active and stage is not None and (work := stage.due(self._now_ns())):
                frame = await self._worker.run(work)
                if stage is self._stage:
                    self._publish(frame)
                stage = self._stage
        except CanceledError:
            pass
        except Exception as error:
            self._stage = None
            reason = self.refuse("the rehearsal stopped, call ~/reset to begin anew", error)
            self._problem = f"stopped, call ~/reset to begin anew: {reason}"
        finally:
            self._is_busy = False

    def _publish(self, frame: RehearsalFrame) -> None:
        stamp = time_message(frame.stamp_ns)
        seen = np.isfinite(frame.points).all(axis=1)
        confidence = np.full(np.count_nonzero(seen), CONFIDENCE, np.float32)
        self._objects.publish(
            points_message(frame.points[seen], ids=np.flatnonzero(seen), confidence=confidence, stamp=stamp)
        )
        self._controllers.publish(points_message(frame.hands, ids=np.arange(len(frame.hands)), stamp=stamp))

    def _take_pose(self, message: PoseStamped) -> None:
        if self._stage is None:
            return
        place, turn = message.pose.position, message.pose.orientation
        self._track.add_pose(
            Time.from_msg(message.header.stamp).nanoseconds,
            np.array([place.x, place.y, place.z]),
            np.array([turn.x, turn.y, turn.z, turn.w]),
        )

    def _take_opening(self, message: Float64) -> None:
        if self._stage is not None:
            self._track.add_opening(self._now_ns(), message.data)

    async def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.is_active:
            response.message = "the node is not active; configure and activate it first"
            return response
        response.success = await self._begin()
        response.message = "the object lies on the table" if response.success else self.last_error
        return response

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)


def main() -> int:
    """Run the node; the exit code."""
    return run_node(RehearsalNode)


if __name__ == "__main__":
    sys.exit(main())
