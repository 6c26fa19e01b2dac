"""Recipes: which network is trained on what, stage by stage."""

from __future__ import annotations

import hashlib
import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from flightdepth.scenes import StillBoxConfig
from flightdepth.stillbox import PairRule, Picture
from flightdepth.stillbox.motion_noise import MotionNoise
from flightdepth.stillbox.photometric import LARGEST_PX
from flightdepth.weights.card import without_finer

STRIDE = 64  # the deepest feature map is at 1/64 of a picture's size
FILE_NAME = r"^[^\s./\\][^/\\]*$"  # of what names a file or a folder of a run
FILE_NAME_RULE = "a name without / that does not begin with a dot"
BATCH_NORM_MOMENTUM = 0.1  # where a recipe names none
OptimizerName = Literal["adamw", "sgd", "muon"]


def _file_name(name: str) -> str:
    if not re.match(FILE_NAME, name):
        raise ValueError(FILE_NAME_RULE)
    return name


FileName = Annotated[str, AfterValidator(_file_name)]
Blocks = Annotated[int, Field(gt=0, multiple_of=STRIDE)]  # pixels


class _Strict(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Stage(_Strict):
    """One stage of the curriculum: crops of `width` x `height` from pictures `full_width` pixels wide."""

    name: FileName
    full_width: int = Field(gt=0)
    width: Blocks
    height: Blocks
    samples: int = Field(gt=0, description="pairs")
    batch: int = Field(gt=0)
    learning_rate: float = Field(gt=0, description="peak, after the warm-up")
    photometric: bool = False
    photometric_share: float = Field(default=1.0, gt=0, le=1, description="of the pairs, with camera effects")
    h264_share: float = Field(default=0.0, ge=0, le=1, description="of the pairs, as two frames of a video")
    wide_share: float = Field(
        default=0.0, ge=0, le=1, description="of the pairs, with a shift of up to a whole scene"
    )
    only_last_look: bool = Field(default=False, description="all but MotionNet's thorough last look stays")
    open_share: float = Field(default=0.0, ge=0, le=1, description="share of scenes in the open, under a sky")
    fov_deg: tuple[float, float] | None = Field(default=None, description="of a lens drawn for each scene")
    upright: bool = Field(default=False, description="scenes in the open are not turned by quarters")
    objects_for_lens: bool = Field(default=False, description="objects look as large through any lens")
    direction_noise_deg: float = Field(
        default=0.0, ge=0, description="largest error of the direction of motion"
    )
    rotation_noise_deg: float = Field(default=0.0, ge=0, description="largest rotation that is not reported")
    optimizer: OptimizerName | None = Field(default=None, description="instead of the recipe's")

    _of_old_runs = model_validator(mode="before")(without_finer)

    @model_validator(mode="after")
    def _fits(self) -> Stage:
        if self.full_width < self.width:
            raise ValueError(f"full_width of at least the width, {self.width}")
        if self.full_width < self.height:
            raise ValueError(f"full_width of at least the height, {self.height}: full pictures are square")
        if self.photometric and max(self.width, self.height) > LARGEST_PX:
            raise ValueError(f"pictures of at most {LARGEST_PX} px where there are camera effects")
        if self.photometric_share < 1 and not self.photometric:
            raise ValueError("photometric = true, of which photometric_share is a share")
        if self.upright and not self.open_share:
            raise ValueError("open_share, of whose scenes upright tells")
        if self.objects_for_lens and self.fov_deg is None:
            raise ValueError("fov_deg, for whose lenses objects are drawn with objects_for_lens")
        if self.fov_deg is not None and not 0 < self.fov_deg[0] <= self.fov_deg[1] < 180:
            raise ValueError("fov_deg of a smaller and a larger angle, between 0 and 180 degrees")
        return self

    @property
    def picture(self) -> Picture:
        """The stage's crop."""
        return Picture(self.width, self.height, self.full_width, self.fov_deg)

    @property
    def noise(self) -> MotionNoise | None:
        """What the stage's motion gets wrong, if anything."""
        noise = MotionNoise(self.direction_noise_deg, self.rotation_noise_deg)
        return None if noise == MotionNoise(0, 0) else noise


class Recipe(_Strict):
    """A network and its curriculum."""

    name: FileName
    architecture: Literal["DepthNet", "FlowNetS", "MotionNet"] = "DepthNet"
    base_width: int = Field(gt=0)
    activation: Literal["elu+1", "none"]
    leaky_slope: float = Field(
        default=0.0, ge=0, lt=1, description="LeakyReLU of that slope where the network has ReLU"
    )
    looks: int = Field(default=1, ge=1, description="times that MotionNet refines its depth")
    thorough_last_look: bool = Field(
        default=False, description="MotionNet's last look has weights of its own, and sees more"
    )
    residual_blocks: bool = Field(default=False, description="MotionNet's trunk has residual blocks")
    batch_norm_momentum: float = Field(
        default=BATCH_NORM_MOMENTUM, gt=0, le=1, description="of the running statistics"
    )
    nominal_shift: int = Field(gt=0)
    depth_min_m: float = Field(ge=0)
    depth_max_m: float = Field(gt=0)
    reference_focal_px: float | None = Field(
        default=None, gt=0, description="for any lens: the focal length at which depth is metres"
    )
    backward_pairs: bool = Field(default=True, description="half of the pairs show the later frame first")
    still_pairs: bool = Field(default=True, description="pairs of one frame, farthest depth everywhere")
    pairs_per_scene: int = Field(default=40, gt=0, description="before another scene takes its place")
    loss: Literal["l1", "saturating-l1"]
    loss_space: Literal["depth", "inverse-depth"] = "depth"
    near_weight_m: float = Field(
        default=0.0,
        ge=0,
        description="an error at depth Z counts 1 + this / Z times: 10 m makes 5 m count threefold",
    )
    optimizer: OptimizerName = Field(
        default="adamw", description="sgd: with momentum 0.9; muon: for kernels, with AdamW for the rest"
    )
    weight_decay: float = Field(ge=0)
    ema_decay: float = Field(ge=0, lt=1)
    warmup_samples: int = Field(ge=0)
    floor: float = Field(ge=0, le=1, description="learning rate at the end of a stage, share of the peak")
    seed: int = Field(ge=0, le=4_000_000)  # the streams' seeds (`loop.stream_seed`) stay below 2^32
    accumulate: int = Field(
        default=1, gt=0, description="equal parts of a batch, each seen by itself: memory, processes"
    )
    starts_from: str | None = Field(
        default=None,
        description="recipe whose last checkpoint is taken over; NAME/STAGE: its checkpoint there; or an ONNX file",
    )
    scenes: StillBoxConfig = StillBoxConfig()
    stages: tuple[Stage, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _fits(self) -> Recipe:
        if self.depth_min_m >= self.depth_max_m:
            raise ValueError(f"depth_max_m of more than depth_min_m, {self.depth_min_m:g}")
        names = [stage.name for stage in self.stages]
        if len(set(names)) < len(names):
            raise ValueError(f"stages of different names, not {', '.join(names)}")
        if "checkpoint" in names:
            raise ValueError("a stage of another name than checkpoint, which is the run's own")
        if any(stage.only_last_look for stage in self.stages) and not self.thorough_last_look:
            raise ValueError("thorough_last_look, since a stage trains that alone")
        if self.reference_focal_px is None and self.architecture == "MotionNet":
            raise ValueError("reference_focal_px, since a MotionNet is for any lens")
        if self.reference_focal_px is None and any(stage.fov_deg for stage in self.stages):
            raise ValueError("reference_focal_px, since a stage has many lenses (fov_deg)")
        if self.loss_space == "inverse-depth" and self.activation == "none":
            raise ValueError(
                'activation = "elu+1", since with loss_space = "inverse-depth" an answer below 0 m never learns'
            )
        if self.scenes.open_share:
            raise ValueError("open_share in each stage, not in scenes")
        if self.scenes.frames < 2:
            raise ValueError("scenes of at least 2 frames, of which pairs are made")
        self._refuse_what_is_not_looked_at()
        return self

    def _refuse_what_is_not_looked_at(self) -> None:
        """Refuse keys that the architecture has no use for: whoever gives them expects another network."""
        if self.architecture == "MotionNet" and self.activation != "elu+1":
            raise ValueError('activation = "elu+1", the only one of a MotionNet')
        asked: dict[str, bool] = {}
        if self.architecture != "MotionNet":
            asked |= {
                "looks": self.looks > 1,
                "thorough_last_look": self.thorough_last_look,
                "residual_blocks": self.residual_blocks,
                "direction_noise_deg": any(stage.direction_noise_deg for stage in self.stages),
            }
        if (
            self.architecture != "DepthNet"
        ):  # FlowNetS has a slope of its own, MotionNet ReLUs that are no layers
            asked["leaky_slope"] = self.leaky_slope > 0
        if self.architecture == "FlowNetS":  # it has no batch norm
            asked["batch_norm_momentum"] = self.batch_norm_momentum != BATCH_NORM_MOMENTUM
        for key in (key for key, given in asked.items() if given):
            raise ValueError(f"no {key}, which a {self.architecture} has no use for")

    def scenes_in(self, stage: Stage) -> StillBoxConfig:
        """What its scenes are drawn by."""
        return self.scenes.model_copy(update={"open_share": stage.open_share})

    def optimizer_in(self, stage: Stage) -> OptimizerName:
        """One that is another than the stage's before is begun anew."""
        return stage.optimizer or self.optimizer

    @property
    def rule(self) -> PairRule:
        """How pairs are drawn and clipped."""
        return PairRule(
            self.nominal_shift,
            self.depth_min_m,
            self.depth_max_m,
            self.reference_focal_px,
            backward=self.backward_pairs,
            still=self.still_pairs,
        )

    @property
    def shift_px_m(self) -> float | None:
        """Pixels that a point at 1 m moves by where a network for any lens says metres: D0 * focal; else None."""
        focal_px = self.reference_focal_px
        return None if focal_px is None else self.nominal_shift * self.scenes.step_m * focal_px

    @property
    def samples(self) -> int:
        """Pairs of all stages."""
        return sum(stage.samples for stage in self.stages)

    @property
    def digest(self) -> str:
        """Short hash of what the recipe sets; a checkpoint of another recipe is not resumed.

        What stands at its default is left out, so that a new knob whose default means "as before" changes no hash.
        """
        return hashlib.sha256(self.model_dump_json(exclude_defaults=True).encode()).hexdigest()[:16]

    def scaled_to(self, samples: int) -> Recipe:
        """The same curriculum with `samples` pairs in all, whole batches, at least one a stage."""
        share = samples / self.samples
        stages = tuple(
            stage.model_copy(
                update={"samples": max(1, round(stage.samples * share / stage.batch)) * stage.batch}
            )
            for stage in self.stages
        )
        warmup = round(self.warmup_samples * min(share, 1.0))
        return self.model_copy(update={"stages": stages, "warmup_samples": warmup})
