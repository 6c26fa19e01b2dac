"""What is written beside a network's weights: how it was trained, on what, and how well it does."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

INSIDE_ONE = 0.6827  # share of normal errors within one standard deviation
# A network for any lens sees flights that much finer than at its recipe's reference focal length.
FLIGHT_DETAIL = 2


def without_finer(facts: Any) -> Any:
    """Facts of a stage without a second size of pictures, which earlier versions told of as none."""
    if not isinstance(facts, dict):
        return facts
    return {key: value for key, value in facts.items() if (key, value) != ("finer", None)}


class Stage(BaseModel):
    """One stage of a training curriculum."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    width: int
    height: int
    focal_px: float
    samples: int
    batch: int
    learning_rate: float
    photometric: bool
    photometric_share: float = Field(default=1.0, description="of the pairs, with camera effects")
    h264_share: float = Field(default=0.0, description="of the pairs, as two frames of a video")
    wide_share: float = Field(default=0.0, description="of the pairs, with a shift of up to a whole scene")
    only_last_look: bool = Field(default=False, description="all but the thorough last look stayed")
    open_share: float = Field(default=0.0, ge=0, le=1, description="share of scenes in the open")
    fov_deg: tuple[float, float] | None = Field(
        default=None, description="of a lens drawn for each scene; `focal_px` is then that of 90 degrees"
    )
    upright: bool = Field(default=False, description="scenes in the open were not turned by quarters")
    objects_for_lens: bool = Field(default=False, description="objects looked as large through any lens")
    direction_noise_deg: float = Field(
        default=0.0, ge=0, description="largest error of the direction of motion"
    )
    rotation_noise_deg: float = Field(default=0.0, ge=0, description="largest rotation that was not reported")
    optimizer: str = "adamw"

    _of_old_cards = model_validator(mode="before")(without_finer)


class Predecessor(BaseModel):
    """The network of the same name that shipped before, from which this one went on learning."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sha256: str = Field(description="of its ONNX file")
    samples: int = Field(ge=0, description="training pairs it had seen")
    l1_m: float | None = Field(description="on the fixed test set, as its card has it")


class NetworkCard(BaseModel):
    """Facts about one network. Lengths in metres, sizes in pixels.

    The network's output is metres at a displacement of `D0_m`; beta = output / depth_max_m, and
    depth = alpha * beta * displacement with alpha = depth_max_m / D0_m (paper, section IV.A).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", protected_namespaces=())

    name: str
    architecture: Literal["DepthNet", "FlowNetS", "MotionNet"]
    base_width: int = Field(description="feature maps of the first convolution: 32, or 16 for Tiny")
    activation: Literal["elu+1", "none"]
    looks: int = Field(default=1, ge=1, description="times that MotionNet refines its depth")
    thorough_last_look: bool = Field(
        default=False, description="MotionNet's last look has weights of its own, and sees more"
    )
    residual_blocks: bool = Field(default=False, description="MotionNet's trunk has residual blocks")
    nominal_shift: int = Field(gt=0, description="frames between the images of a nominal training pair")
    D0_m: float = Field(gt=0, description="displacement of a nominal training pair")
    depth_min_m: float = Field(ge=0, description="lower clip of the training depth; 0 where there is none")
    depth_max_m: float = Field(gt=0, description="upper clip of the training depth")
    focal_px: float = Field(gt=0, description="focal length that pictures are scaled to, and D0 belongs to")
    sigma_scale: float = Field(
        default=1.0,
        gt=0,
        description="times the error bar that the weights give, so that 68 % of errors are inside",
    )
    sigma_growth: float = Field(
        default=0.0,
        description="logarithm by which that is larger in a picture that is all sky",
    )
    sigma_lens: float = Field(
        default=0.0,
        description="power of the focal length, over `error_bar.USUAL_FOCAL_PX`, that it is larger by",
    )
    sigma_far: float = Field(
        default=0.0,
        description="power of the output, over `error_bar.USUAL_BETA`, that it is larger by where all is sky",
    )
    int8_ranges: dict[str, tuple[float, float]] = Field(
        default_factory=dict,
        description="of what enters a convolution, by the name of its weights in the ONNX file",
    )
    best_beta: float | None = Field(
        default=None,
        gt=0,
        lt=1,
        description="output, as a share of the largest depth, that displacements are chosen for; None: by its kind",
    )
    any_lens: bool = Field(default=False, description="trained with many focal lengths: see `at_focal`")
    width: int = Field(gt=0, description="picture width of the last training stage")
    height: int = Field(gt=0, description="picture height of the last training stage")
    samples: int = Field(ge=0, description="training pairs seen, all stages")
    stages: tuple[Stage, ...] = ()
    mean_with: str = Field(default="", description="SHA-256 of the network whose weights were averaged in")
    went_on_from: Predecessor | None = None
    renderer: str = ""
    set_version: str = ""
    seed: int = 0
    metrics: dict[str, float] = Field(default_factory=dict, description="on the fixed test set")
    sha256: str = Field(default="", description="of the ONNX file")

    @property
    def alpha(self) -> float:
        """Largest depth over nominal displacement (paper, equation 3)."""
        return self.depth_max_m / self.D0_m

    @property
    def knows_direction(self) -> bool:
        """Whether it takes the direction of the displacement, not its length alone."""
        return self.architecture == "MotionNet"

    def at_focal(self, focal_px: float) -> NetworkCard:
        """The same network at another focal length, if it knows any: what moves a pixel as far is D0 there.

        D0 focal = constant, since a point at depth Z moves by focal D / Z pixels. Other networks: the card itself.
        """
        if not self.any_lens:
            return self
        return self.model_copy(update={"focal_px": focal_px, "D0_m": self.D0_m * self.focal_px / focal_px})

    @property
    def beta_min(self) -> float:
        """Lower end of the output, as a share of the largest depth: below it depth is 'at most'."""
        return self.depth_min_m / self.depth_max_m
