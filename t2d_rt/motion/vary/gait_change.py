"""What is changed in a recorded walk to make another gait of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class GaitChange:
    """What is changed in a walk; the defaults change nothing. Pairs are left and right."""

    stride: float = 1.0
    """Factor of the step length."""
    cadence: float = 1.0
    """Factor of the steps per second."""
    step_width_m: float | None = None
    """Distance of the feet across the path [m]; None keeps the walk's."""
    lift: tuple[float, float] = (1.0, 1.0)
    """Factors of the height of the ankles in swing."""
    foot_drop_rad: tuple[float, float] = (0.0, 0.0)
    """Angles by which the feet hang in swing [rad]."""
    equinus_rad: float = 0.0
    """Angle by which the heels are up all the time [rad]: walking on the toes."""
    shorter_step_m: tuple[float, float] = (0.0, 0.0)
    """What the feet land short of their place [m]."""
    hurried_stance: tuple[float, float] = (1.0, 1.0)
    """Factors of the tempo while the foot bears the weight alone: above 1 its stance is short."""
    lean_rad: float = 0.0
    """Forward lean of the trunk [rad]."""
    trunk_roll_rad: tuple[float, float] = (0.0, 0.0)
    """Leans of the trunk over the standing foot [rad]."""
    pelvis_drop_rad: tuple[float, float] = (0.0, 0.0)
    """Drops of the pelvis on the side of the swing while the foot stands [rad] (Trendelenburg's sign)."""
    pelvis_shift_m: float = 0.0
    """Shift of the pelvis over the standing foot [m], beyond the recorded one."""
    pelvis_turn: float = 1.0
    """Factor of the pelvis's turning about the vertical."""
    crouch_m: float = 0.0
    """What the pelvis is lowered by [m]: knees stay bent."""
    knees_inward_rad: float = 0.0
    """Rotation of the knees towards each other about the line from hip to ankle [rad]."""
    circumduction_m: float = 0.0
    """What a swinging foot goes outward by [m]."""
    arm_swing: tuple[float, float] = (1.0, 1.0)
    """Factors of the arms' swing."""
    elbow_bend_rad: float = 0.0
    """Further bend of the elbows [rad]."""
    arms_apart_rad: float = 0.0
    """Angle by which the arms are held away from the body [rad]."""
    step_time_spread: float = 0.0
    """Standard deviation of the logarithm of each step's tempo."""
    placement_m: tuple[float, float] = (0.0, 0.0)
    """Standard deviations of where feet are put, along and across the path [m]."""
    unsteady_rad: float = 0.0
    """Standard deviation of the trunk's slow swaying, forward and sideways [rad]."""
    hurry: float = 0.0
    """Festination: over the walk the steps shorten to exp(-hurry) of their length and come exp(hurry) times as fast."""
    freezes_s: tuple[float, ...] = ()
    """Durations of the halts at which the feet stick to the floor and the knees tremble [s]."""
    tremble_hz: float = 6.0
    """Frequency of the trembling [Hz]."""
    hand_tremor_rad: float = 0.0
    """Amplitude of the hands' tremor at rest [rad]."""
