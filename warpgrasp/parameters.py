"""Every number of the physical model, one table per device, each with its source.

Tags: [paper] Allen and Michelman 1990; [ref] read in the source named; [est] an estimate, no
source found. Inside the program all units are SI; a spec writes the same fields in `_mm` and
`_deg` (see `sweeps.spec`). Bounds and choices in the metadata are checked where a spec is read.
"""

from dataclasses import dataclass, field, fields
from math import ceil, erfc, expm1, log1p, pi, radians, sqrt

from warpgrasp.spec_words import choice, number, reckoned, spec_words
from warpgrasp.table_misfit import factor_misfit, pad_length_misfit, pad_width_misfit

TAXELS = 16
"""Rows and columns of a pad [paper]."""
OBJECT_REACH_M = 2.0
"""How far from the robot's base an object may stand, along x and along y."""
ARM_COLUMN_M = 0.1
"""Radius of what an arm stands on, where no object can stand [est]."""

PUMA560, FLOATING = "puma560", "none"
UTAH_MIT = "utah_mit"
"""The paper's hand, whose numbers are those of `HandTable`."""


@spec_words
@dataclass(frozen=True)
class ArmTable:
    """PUMA 560, standard Denavit-Hartenberg parameters (robotics-toolbox-python) [ref].

    Or another arm, by its `kind`, which has joints of its own: of this table then count encoder
    step, repeatability, the time of a guarded step and the speed of finger strokes. Or none: a
    wrist that floats within a box, where every pose is reachable.
    """

    kind: str = field(default=PUMA560, metadata={
        "doc": "the arm: puma560, another one that ships (`warpgrasp arms`), or a TOML file; none: "
               "a floating wrist, whose box and speeds count in place of what joints have"})
    d_m: tuple[float, ...] = number((0.67183, 0.0, 0.15005, 0.4318, 0.0, 0.0), 0.0, 2.0,
                                    "joint offsets [ref]")
    a_m: tuple[float, ...] = number((0.0, 0.4318, 0.0203, 0.0, 0.0, 0.0), 0.0, 2.0,
                                    "link lengths [ref]")
    limit_low_rad: tuple[float, ...] = number(
        tuple(radians(v) for v in (-160, -35, -225, -266, -100, -266)), -2 * pi, 2 * pi,
        "joint limits [ref: Unimation bulletin]")
    limit_high_rad: tuple[float, ...] = number(
        tuple(radians(v) for v in (160, 215, 45, 266, 100, 266)), -2 * pi, 2 * pi,
        "joint limits [ref: Unimation bulletin]")
    speed_rad_s: tuple[float, ...] = number(
        tuple(radians(v) for v in (82, 54, 122, 228, 241, 228)), 1e-3, 100.0, "joint speeds [est]")
    encoder_step_rad: float = number(1e-4, 0.0, 0.1, "encoder step [est]")
    repeatability_m: float = number(1e-4, 0.0, 0.1, "sigma of the tip's place [ref: bulletin]")
    box_low_m: tuple[float, ...] = number((-1.0, -1.0, 0.0), -5.0, 5.0, "corner of the box of a "
                                          "floating wrist's flange [est]")
    box_high_m: tuple[float, ...] = number((1.0, 1.0, 1.5), -5.0, 5.0, "the opposite corner [est]")
    wrist_speed_m_s: float = number(0.5, 1e-3, 100.0, "of a floating wrist [est]")
    wrist_turn_rad_s: float = number(radians(120), 1e-3, 100.0, "same, turning [est]")
    guarded_step_s: float = number(0.05, 0.0, 10.0, "of one guarded step of fingers or "
                                   "arm: command, rest, reading [est]")
    finger_speed_rad_s: float = number(radians(90), 1e-3, 100.0, "finger strokes, not "
                                       "guarded [est]")


@spec_words
@dataclass(frozen=True)
class HandTable:
    """Utah-MIT hand: four identical fingers of four joints, thumb opposite three [paper].

    Link lengths are estimates bracketed by GraspIt!'s human hand and the Allegro hand. Or another
    hand, by its `kind`: of this table then count mount, palm thickness, stops, density and skin.
    """

    kind: str = field(default=UTAH_MIT, metadata={
        "doc": "the hand: utah_mit, another one that ships (`warpgrasp hands`), or a TOML file"})
    abduction_offset_m: float = number(0.0095, 0.0, 0.1, "abduction axis to first flexion [est]")
    link_length_m: tuple[float, ...] = number((0.043, 0.033, 0.028), 0.005, 0.2,
                                              "proximal, middle, distal link [est]")
    link_radius_m: float = number(0.008, 0.001, 0.05, "capsule radius of a link [est]")
    finger_spacing_m: float = number(0.028, 0.0, 0.1, "between neighbouring fingers [est]")
    palm_gap_m: float = number(0.080, 0.02, 0.3, "fingers' bases to the thumb's base [est]")
    palm_thickness_m: float = number(0.040, 0.0, 0.2, "palm slab behind the finger bases [est]")
    mount_length_m: float = number(0.100, 0.0, 0.5, "wrist flange to finger bases [est]")
    abduction_limit_rad: tuple[float, ...] = number((radians(-25), radians(25)), -pi, pi, "[est]")
    flexion_low_rad: tuple[float, ...] = number((radians(-10), 0.0, 0.0), -pi, pi, "[est]")
    flexion_high_rad: tuple[float, ...] = number(
        (radians(90), radians(95), radians(95)), -pi, pi, "[est]")
    moment_arm_m: tuple[float, ...] = number((0.010, 0.010, 0.008, 0.006), 1e-3, 0.1,
                                             "tendon moment arm of each joint [est]")
    co_contraction_N: float = number(9.0, 0.0, 200.0, "tension of both tendons at rest [est]")
    tension_low_N: float = number(2.0, 0.0, 200.0, "no tendon is let slacker than this; the "
                                  "other one of its joint then carries the rest [est]")
    joint_stiffness_Nm_rad: float = number(2.0, 0.01, 1000.0, "joint position servo [est]")
    joint_stop_Nm_rad: float = number(200.0, 1.0, 1e6, "stiffness of a joint's stops [est]")
    link_density_kg_m3: float = number(1000.0, 0.0, 2e4, "of the fingers' links [est]")
    skin_stiffness_N_m: float = number(2e4, 10.0, 1e7, "skin of a link [est]")
    tendon_friction: float = number(0.07, 0.0, 0.9, "Coulomb, fraction of the tension [est]")


@spec_words
@dataclass(frozen=True)
class SensorTable:
    """32 tendon tensions and 16 joint angles of the hand [paper], their errors, the threshold."""

    tendon_threshold_N: float = number(6.0, 0.0, 1000.0,
                                       "stop when flexor - extensor tension passes this [est]")
    tension_noise_N: float = number(0.3, 0.0, 50.0, "sigma of one reading [est]")
    tension_step_N: float = number(0.05, 0.0, 10.0, "converter step; 0 switches it off [est]")
    tension_readings: int = number(16, 1, 1000, "readings averaged after the stop")
    joint_noise_rad: float = number(radians(0.3), 0.0, 0.5, "sigma of a joint angle [est]")
    torque_threshold_Nm: float = number(0.05, 1e-6, 100.0, "of hands that read joint torques: "
                                        "stop when one, less the links' weight, passes this [est]")
    torque_noise_Nm: float = number(0.003, 0.0, 10.0, "sigma of one reading of theirs [est]")
    torque_step_Nm: float = number(0.001, 0.0, 10.0, "its converter step; 0 switches it off [est]")
    torque_friction_Nm: float = number(0.01, 0.0, 10.0, "of the gears between joint and motor, "
                                       "where the torque is read [est]")
    switch_force_N: float = number(0.5, 1e-6, 1000.0, "of hands with switches in their tips: the "
                                   "force that closes one [est]")
    contact_estimator: str = choice("intrinsic", ("fingertip", "intrinsic"),
                                    "fingertip: the paper's; intrinsic: from joint torques")


@spec_words
@dataclass(frozen=True)
class ContactTable:
    """What acts on a finger beside its servos and the skin; each can be switched off."""

    joint_stops: bool = field(default=True, metadata={"doc": "joints end at their limits"})
    weight: bool = field(default=True, metadata={"doc": "links weigh down on the servos"})
    self_contact: bool = field(default=True, metadata={
        "doc": "fingers stop at one another and at the palm"})
    friction: float = number(0.5, 0.0, 2.0, "coefficient of the skin on object and table; 0: it "
                             "slides freely [est]")

    @staticmethod
    def none() -> "ContactTable":
        """Nothing beside them."""
        return ContactTable(joint_stops=False, weight=False, self_contact=False, friction=0.0)


@spec_words
@dataclass(frozen=True)
class ErrorTable:
    """How the robot that is differs from the robot that is believed: standard deviations.

    Drawn once an episode. The paper names the arm's calibration, the joint sensors and the hand's
    kinematic model as its sources of error; the sizes are estimates. The robot knows these
    deviations, and weighs its contacts by them; it never knows what was drawn.
    """

    joint_offset_rad: float = number(radians(0.5), 0.0, 0.5,
                                     "zero of each joint sensor of the hand [est]")
    link_length_share: float = number(0.01, 0.0, 0.2, "length of each link of the hand [est]")
    finger_base_m: float = number(5e-4, 0.0, 0.02, "place of each finger's base, per axis [est]")
    moment_arm_share: float = number(0.05, 0.0, 0.3, "moment arm of each joint's tendons [est]")
    arm_joint_offset_rad: float = number(radians(0.03), 0.0, 0.1,
                                         "zero of each joint sensor of the arm [est]")
    arm_link_m: float = number(3e-4, 0.0, 0.02, "each length of the arm's DH table [est]")
    mount_m: float = number(5e-4, 0.0, 0.1, "of the hand's mount on the arm, per axis [est]")
    mount_rad: float = number(radians(0.2), 0.0, 0.5, "same, rotation vector [est]")
    pad_m: float = number(5e-4, 0.0, 0.005, "place of each pad on its link, both ways [est]")
    pad_gain_share: float = number(0.10, 0.0, 0.5, "gain of each pad as a whole [est]")
    scale: float = number(1.0, 0.0, 10.0, "factor of all of these; 0: the tables are true")

    def misfit(self, pads: bool = True) -> str:
        """Why a factor could be zero or less, with `pads` also of their gains; empty where none."""
        named = ("link_length_share", "moment_arm_share", *["pad_gain_share"] * pads)
        return factor_misfit({name: self.scale * getattr(self, name) for name in named})

    @staticmethod
    def none() -> "ErrorTable":
        """The robot that is believed."""
        return ErrorTable(**{f.name: float(f.name == "scale") for f in fields(ErrorTable)})

    def scaled(self) -> "ErrorTable":
        """The deviations times `scale`, which is then one."""
        return reckoned(self, **{f.name: 1.0 if f.name == "scale" else self.scale * getattr(
            self, f.name) for f in fields(self)})


@spec_words
@dataclass(frozen=True)
class RobotTable:
    """Whose tables a sweep varies."""

    swept: str = choice("both", ("both", "truth", "belief"), "whose [hand], [sensors] and "
                        "[errors] a sweep varies: the robot's that is, that it believes, or both")


@dataclass(frozen=True)
class TrueTables:
    """What the robot that is differs in from the robot that is believed."""

    hand: HandTable
    sensors: SensorTable
    errors: ErrorTable


@spec_words
@dataclass(frozen=True)
class PadTable:
    """Force-sensing pads of 16 x 16 taxels on 0.5 x 1.0 in, 8-bit converter [paper].

    A taxel is an elastic-foundation spring; what its resistance is to force, `law` says: falling
    exponentially [paper] or as the vendor's inverse power [ref]. It is read in a voltage divider.
    Pads sit on the palmar faces; up to 16 can be addressed [paper], a hand has room for 12.
    """

    distal: bool = field(default=True, metadata={"doc": "pads on the four distal links [paper]"})
    middle: bool = field(default=False, metadata={"doc": "pads on the middle links"})
    proximal: bool = field(default=False, metadata={"doc": "pads on the proximal links"})
    width_m: float = number(0.0127, 0.002, 0.05, "across the link [paper]")
    length_m: float = number(0.0254, 0.002, 0.05, "along the link [paper]")
    wrap_rad: float = number(radians(80), 0.0, pi / 2,
                             "how far the distal pad bends over the fingertip [est]")
    thickness_m: float = number(0.001, 1e-4, 0.01, "stands proud of the link's skin [est]")
    stiffness_N_m: float = number(1000.0, 1.0, 1e6, "of one taxel: 1 N at 1 mm [est]")
    flat_stiffness_N_m: float = number(2e4, 1.0, 1e8,
                                       "of one taxel pressed flat, beyond the thickness [est]")
    law: str = choice("exponential", ("exponential", "inverse_power"),
                      "resistance against force")
    rest_ohm: float = number(1e5, 1.0, 1e9, "resistance without force [est]")
    least_ohm: float = number(1e3, 0.0, 1e9, "resistance at great force, exponential law [est]")
    force_scale_N: float = number(0.3, 1e-3, 100.0, "e-fold of the exponential law [est]")
    newton_ohm: float = number(3e3, 1.0, 1e9, "resistance at 1 N, inverse power law [est]")
    power: float = number(1.0, 0.1, 5.0, "exponent of the inverse power law [ref]")
    reference_ohm: float = number(1e4, 1.0, 1e9, "the other resistor of the divider [est]")
    floor_N: float = number(0.013, 0.0, 10.0, "a taxel feels nothing below [ref, scaled]")
    saturation_N: float = number(1.2, 1e-3, 100.0, "full scale of the converter [ref, scaled]")
    gain_spread: float = number(0.15, 0.0, 0.5, "sigma between taxels, fixed per episode [ref]")
    repeatability: float = number(0.03, 0.0, 0.5, "sigma of one taxel from time to time [ref]")
    noise_counts: float = number(1.0, 0.0, 100.0, "sigma of one reading [est]")
    dead_fraction: float = number(0.005, 0.0, 1.0, "taxels that always read 0 [est]")
    threshold_counts: float = number(6.0, 1.0, 255.0, "a pad feels from here on [est]")
    yield_rad: float = number(radians(1.5), 1e-4, 1.0,
                              "a joint this far from its command did not move the whole way [est]")

    def misfit(self, hand: HandTable) -> str:
        """Why pads of this size do not fit the hand's links; empty where they do."""
        for link, on in enumerate((self.proximal, self.middle, self.distal)):
            bent = self.wrap_rad * (hand.link_radius_m + self.thickness_m) if link == 2 else 0.0
            if on and (wrong := pad_length_misfit(link, self.length_m, bent,
                                                  hand.link_length_m[link])):
                return wrong
        on = self.proximal or self.middle or self.distal
        return pad_width_misfit(self.width_m, hand.link_radius_m + self.thickness_m) if on else ""

    def insensitive(self) -> str:
        """Why no force changes a reading; empty where forces do."""
        pressed = (self.least_ohm if self.law == "exponential"
                   else self.newton_ohm * self.saturation_N**-self.power)
        if pressed >= self.rest_ohm:
            return (f"pad of {pressed:g} ohm under load: wants less than without, "
                    f"{self.rest_ohm:g} ohm")
        if self.floor_N >= self.saturation_N:
            return (f"taxels feel from {self.floor_N:g} N on: wants less than the full scale, "
                    f"{self.saturation_N:g} N")
        return ""

    def false_touch_probability(self) -> float:
        """The probability that noise alone raises a taxel of one unloaded pad to the threshold in
        a reading.

        Counts are rounded: the threshold is reached from half a count below the next whole number.
        """
        if self.noise_counts == 0.0:
            return 0.0
        level = (ceil(self.threshold_counts) - 0.5) / self.noise_counts
        one = 0.5 * erfc(level / sqrt(2.0)) * (1.0 - self.dead_fraction)
        return -expm1(TAXELS**2 * log1p(-one)) if one < 1.0 else 1.0


@spec_words
@dataclass(frozen=True)
class StereoTable:
    """Two pinhole cameras side by side, both turned towards the object [est]."""

    pixels: int = number(256, 16, 1024, "rows and columns of an image [est]")
    field_of_view_rad: float = number(radians(30), 0.01, 2.0, "full angle of an image [est]")
    distance_m: float = number(0.8, 0.1, 10.0, "cameras to the place looked at [est]")
    baseline_m: float = number(0.3, 1e-3, 5.0, "between the cameras [est]")
    azimuth_rad: float = number(radians(-90), -2 * pi, 2 * pi, "of the cameras, seen from the "
                                "object, from the x axis [est]")
    elevation_rad: float = number(radians(15), -1.5, 1.5, "of the cameras above the object [est]")
    pixel_noise: float = number(0.3, 0.0, 20.0, "sigma of an edge's place in pixels [est]")
    missing_edges: float = number(0.0, 0.0, 0.9, "share of a silhouette's edge lost in gaps, "
                                  "where the object looks like what is behind it [est]")
    spurious_edges: int = number(0, 0, 100, "lines in each image that are no edges of the object "
                                 "[est]")
    clutter: int = number(0, 0, 100, "things behind the object in each image that look like it "
                          "[est]")
    flipped_pixels: float = number(0.0, 0.0, 0.4, "share of pixels taken for the other side "
                                   "[est]")
    missing_depth: float = number(0.2, 0.0, 0.95, "share of patches of a depth image in which the "
                                  "two images are not matched [est]")


@spec_words
@dataclass(frozen=True)
class ObjectTable:
    """Where the object stands, and the errors of the prior given to a strategy."""

    x_m: float = number(0.45, -OBJECT_REACH_M, OBJECT_REACH_M,
                        "place on the table, base frame [paper: near]")
    y_m: float = number(0.0, -OBJECT_REACH_M, OBJECT_REACH_M, "place on the table")
    yaw_rad: float | None = number(None, -2 * pi, 2 * pi,
                                   "turn about the vertical; unset: at random")
    prior: str = choice("cylinder", ("cylinder", "box", "silhouettes", "depth"),
                        "what is given: a bounding cylinder, the narrowest upright box, a "
                        "cylinder from silhouettes of two cameras, or a box about what they see "
                        "from one side, with the depths that they see ([stereo])")
    prior_sigma_m: float = number(0.010, 0.0, 0.5, "error of each number of the prior [est]")


@spec_words
@dataclass(frozen=True)
class FitTable:
    """What evidence the recovered body is fitted to; each can be switched off."""

    taper: bool = field(default=True, metadata={"doc": "13 instead of 11 parameters"})
    bend: bool = field(default=False, metadata={
        "doc": "along an arc of a circle: two parameters more"})
    table_plane: bool = field(default=True, metadata={"doc": "the body stands on the table"})
    free_space: bool = field(default=True, metadata={"doc": "links that swept lie outside"})
    free_tips: bool = field(default=False, metadata={
        "doc": "so do fingertips whose pads met nothing, if free_space"})
    normals: bool = field(default=False, metadata={
        "doc": "normals felt by pads, as planes of the dual body"})
    weights: bool = field(default=True, metadata={"doc": "weigh contacts by their covariance"})
    loss: str = choice("cauchy", ("none", "cauchy"), "robust loss of the point residuals")
    residual: str = choice("solina_first", ("solina_first", "solina", "solina_box", "radial",
                                             "distance", "volume_distance"),
                           "solina and those of the box or volume prefer the smallest body; "
                           "solina_first takes solina_box, and volume_distance once a body is "
                           "found")
    rivals: bool = field(default=True, metadata={
        "doc": "another residual too, where touches lie far from the body"})
    flat_ends: bool = field(default=True, metadata={
        "doc": "prior on eps1: flat ends rather than round ones, where touches do not tell"})
    shape_prior: bool = field(default=True, metadata={
        "doc": "weak prior on both exponents and the taper, towards the middles of their ranges"})
    upright_rad: float | None = number(0.01, 1e-3, 10.0,
                                       "sigma of the tilt of a body that stands on the table")
    rounds: int = number(4, 0, 32, "times contacts are re-projected onto the body last fitted")
    reconstruct: str = field(default="superquadric", metadata={
        "doc": "what stands for the body at the end: superquadric, the model recovered; implicit, "
               "a free-form surface, about a body that explains its contacts if one does; chosen, "
               "that where the model does not explain the touches, or what explains them better: "
               "a polyhedron of the faces crossed, a bent superquadric; "
               "parts, two to four superquadrics where touches ask for them; "
               "or a function of yours, as mine.py:my_network"})

    @property
    def free_forms(self) -> bool:
        """Whether a free form may stand for the body."""
        return self.reconstruct in ("implicit", "chosen")

    @property
    def superquadric_name(self) -> str:
        """How rows name the model: superquadric, tapered_superquadric, bent_superquadric,
        tapered_bent_superquadric."""
        return "tapered_" * self.taper + "bent_" * self.bend + "superquadric"


@dataclass(frozen=True)
class RecognitionTable:
    """Which of the known objects was felt."""

    way: str = choice("as_felt", ("as_felt", "faces", "profile", "parameters",
                                   "catalogue_alignment"),
                      "what is compared with models recovered before; as_felt: faces where two "
                      "were felt, else the profile of a contour, else the parameters; "
                      "catalogue_alignment lays the catalogue's exact bodies on the touches")
    models: str = field(default="", metadata={
        "doc": "a file that `warpgrasp learn` wrote; empty: the models that ship"})
    none_prior: float = number(0.2, 1e-3, 0.999, "probability of an object that is not among the "
                               "models, before anything is felt [est]")


@spec_words
@dataclass(frozen=True)
class ScoreTable:
    """How finely recovered bodies are compared with true ones."""

    samples: str = choice("standard", ("standard", "dense"),
                          "how many samples of surfaces and volumes scores are made from; dense "
                          "takes sixteen times as many, and a hundred milliseconds an episode")
