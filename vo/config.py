"""Every choice of the estimator, with its unit and its default."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from vo.contract.settings import Settings


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError("must be odd")
    return value


PatchSide = Annotated[int, Field(ge=5, le=31), AfterValidator(_odd)]
"""Side of a square patch about a pixel."""


class FeatureSettings(Settings):
    """CenSurE (thesis 3.2), or Harris corners to compare with."""

    detector: Literal["censure", "harris"] = "censure"
    kernel: Literal["box", "octagon", "star"] = Field(
        default="octagon", description="shape of CenSurE's centre and surround"
    )
    scales: int = Field(
        default=7, ge=3, le=7, description="sizes of the kernel; all but the outer two find"
    )
    count: int = Field(default=800, ge=1, description="features kept per image")
    threshold: float = Field(
        default=4.0, ge=0, description="least contrast of a feature, grey levels"
    )
    line_ratio: float = Field(
        default=12.0, gt=1, description="largest ratio of principal gradients"
    )
    smoothing_px: float = Field(
        default=0.8, ge=0, description="Gaussian that noisy images go through; 0 never"
    )
    noisy_grey: float = Field(
        default=3.5, ge=0, description="standard deviation of noise beyond which images are noisy"
    )
    apart_px: float = Field(
        default=5.0, ge=0, description="least distance of new landmarks to others"
    )
    cell_px: int = Field(
        default=40, ge=8, description="side of the cells among which features are spread"
    )


class MatchingSettings(Settings):
    """ZNCC with marriage assignment (thesis 3.2) and sub-pixel alignment."""

    patch_px: PatchSide = Field(default=13, description="side of the correlated patch")
    zncc: float = Field(default=0.75, gt=0, lt=1, description="least correlation of a match")
    predict: Literal["steady", "still"] = Field(
        default="steady", description="where to search first: the last motion goes on, or ended"
    )
    search_px: float = Field(
        default=24.0, gt=0, description="radius of the window around the prediction"
    )
    widest_search_px: float = Field(
        default=96.0, gt=0, description="radius while nothing can be predicted"
    )
    convincing: float = Field(
        default=0.22,
        ge=0,
        le=1,
        description="share of the landmarks in view that must agree with a pose, or others are "
        "tried, as the whole image has turned and by flow; 0 takes the first",
    )
    triplets: bool = Field(
        default=False, description="matches must be consistent with the frame before (F4)"
    )
    guided: bool = Field(
        default=True, description="look for the other landmarks where the first pose puts them (F5)"
    )
    guided_quantile: float = Field(
        default=0.35, ge=0, le=1, description="they must be as alike as this share of the others"
    )
    align: bool = Field(
        default=True, description="place matches by their intensities, not by the feature"
    )
    align_px: PatchSide = Field(default=9, description="side of the patch aligned to sub-pixels")
    align_zncc: float = Field(
        default=0.85, gt=0, lt=1, description="least correlation after alignment"
    )
    align_reach_px: float = Field(
        default=3.0, gt=0, description="most that alignment may move a feature"
    )
    most_zoom: float = Field(
        default=1.3, gt=1, description="change of size after which templates renew"
    )

    @model_validator(mode="after")
    def _guided_matches_are_aligned(self) -> Self:
        if self.guided and not self.align:
            raise ValueError("matching.guided needs matching.align")
        return self


class StereoSettings(Settings):
    """Disparity at the features, sparse or from a dense map (thesis 3.1), made sub-pixel."""

    method: Literal["sparse", "block_matching", "semi_global"] = "sparse"
    search_px: PatchSide = Field(default=9, description="sparse: side of the correlated patch")
    distinct: float = Field(
        default=1.5, ge=1, description="sparse: least ratio of 1 - ZNCC, the next best to the best"
    )
    expected_reach_px: float = Field(
        default=3.0, gt=0, description="sparse: search about a disparity that is expected"
    )
    shrink: int = Field(
        default=2, ge=1, le=4, description="dense: works on images this much smaller"
    )
    block_px: PatchSide = Field(default=15, description="block matching: side of the block")
    most_disparity_px: float = Field(
        default=96.0, gt=0, description="the closest point searched for"
    )
    least_disparity_px: float = Field(
        default=1.0,
        ge=0,
        description="depth gate; 8 is 5.1 m with the default rig, as in thesis 3.1; 0 is none",
    )
    refine: bool = Field(default=True, description="align the patches to sub-pixels")
    align_px: PatchSide = Field(default=9, description="side of the patch aligned across the pair")
    align_zncc: float = Field(default=0.5, gt=0, lt=1, description="least left-right correlation")
    most_sigma_px: float = Field(
        default=0.3, gt=0, description="largest standard deviation by the noise of the images"
    )
    most_spread_px: float = Field(
        default=0.6, gt=0, description="largest disagreement of windows shifted left and right"
    )


class MotionSettings(Settings):
    """Orientation under RANSAC (thesis 2.6, 2.7, 3.3, 5.4)."""

    method: Literal["relative", "absolute", "split", "refinement"] = Field(
        default="relative",
        description="from points and pixels, from points and points (4.1), rotation from far "
        "points before translation from near ones (F6), or by refinement of the expected motion "
        "alone (F8)",
    )
    solver: Literal["fischler_bolles", "lambda_twist"] = Field(
        default="lambda_twist", description="of the three legs, if relative"
    )
    absolute_solver: Literal["horn", "umeyama"] = "horn"
    scheme: Literal["adaptive", "preemptive"] = Field(
        default="adaptive", description="one hypothesis after the other, or all side by side"
    )
    score: Literal["inliers", "msac"] = Field(
        default="msac", description="count inliers, or weigh each by how well it fits"
    )
    residual: Literal["reprojection", "distance"] = Field(
        default="reprojection", description="what is held against the threshold; distance in metres"
    )
    threshold: float = Field(default=0.003, gt=0, description="acceptance by reprojection (5.4)")
    threshold_unit: Literal["normalized", "pixels"] = "normalized"
    threshold_m: float = Field(default=0.05, gt=0, description="acceptance by distance")
    confidence: float = Field(default=0.9999, gt=0, lt=1, description="1 - p_fail")
    most_trials: int = Field(default=500, ge=1, description="all of them, if preemptive")
    preemptive_block: int = Field(
        default=10, ge=1, description="matches between two halvings of the hypotheses"
    )
    local_rounds: int = Field(
        default=4, ge=0, description="refits to the inliers of each new best; 0 is plain RANSAC"
    )
    prior: bool = Field(
        default=False,
        description="landmarks that were at rest, or where expected, weigh more; others go",
    )
    least_inliers: int = Field(default=8, ge=3, description="fewer, and the frame is lost")
    weak_inliers: int = Field(default=25, ge=3, description="fewer, and the frame is weak")

    @model_validator(mode="after")
    def _distances_need_points(self) -> Self:
        if self.residual == "distance" and self.method != "absolute":
            raise ValueError('motion.residual "distance" needs motion.method "absolute"')
        return self


class RefinementSettings(Settings):
    """Bundle adjustment (thesis 2.8, 3.4)."""

    mode: Literal["none", "motion", "window", "fixed_lag"] = Field(
        default="window",
        description="what is refined: nothing, every frame's pose, also the last keyframes with "
        "what they see, or these incrementally with what older ones left behind",
    )
    smooth: Literal["none", "window", "global"] = Field(
        default="window",
        description="trajectory at the end: none, by the last refinement, or by one of all",
    )
    window: int = Field(default=8, ge=2, description="keyframes refined together")
    least_views: int = Field(
        default=3, ge=2, description="frames that must see a refined point (4.4)"
    )
    least_parallax_deg: float = Field(
        default=0.0,
        ge=0,
        lt=90,
        description="rays of a refined point, eyes and keyframes together, must differ by this",
    )
    use_disparity: bool = Field(
        default=True, description="refine by both eyes, or by the left one as in eq. 2.29"
    )
    drop_iterations: int = Field(
        default=0,
        ge=0,
        description="a frame whose pose takes more is weak and no keyframe (5.3); 0 never",
    )
    firewall_keyframes: int = Field(
        default=0,
        ge=0,
        description="keyframes after which all landmarks are triangulated anew (F7); 0 never",
    )
    sigma_px: float = Field(
        default=0.07, gt=0, description="error of u and v beside what noise explains"
    )
    sigma_disparity_px: float = Field(
        default=0.15, gt=0, description="error of the disparity beside what noise explains"
    )
    covariance: Literal["assumed", "residuals"] = Field(
        default="residuals",
        description="of poses: by the noise assumed, or by residuals where these show more",
    )
    learn_noise: bool = Field(
        default=True, description="let residuals correct these two errors on the way"
    )
    huber: float = Field(default=1.5, gt=0, description="where the loss turns linear, in sigmas")
    most_iterations: int = Field(default=15, ge=1)
    keyframe_parallax_px: float = Field(
        default=15.0, ge=0, description="median flow that starts a keyframe"
    )
    keyframe_share: float = Field(
        default=0.3,
        gt=0,
        le=1,
        description="tracked share of the landmarks, by squared disparity, that starts one",
    )


class FaintSettings(Settings):
    """What images are met with whose texture hardly exceeds their noise."""

    texture_to_noise: float = Field(
        default=3.0, ge=0, description="energy of texture over noise below which they are; 0 never"
    )
    window_growth: float = Field(
        default=1.5, ge=1, description="so much wider are the windows of alignment"
    )
    search_growth: float = Field(
        default=1.9, ge=1, description="and those of sparse stereo's search"
    )
    sigma_growth: float = Field(
        default=2.0, ge=1, description="so much less exact may disparities be"
    )


class SoftSettings(Settings):
    """What images are met with that are out of focus."""

    softness: float = Field(
        default=3.5,
        ge=0,
        description="energy of differences over 4 pixels to those over 2, of which smooth images "
        "have 4, beyond which they are; 0 never",
    )
    window_growth: float = Field(
        default=2.1, ge=1, description="so much wider are the windows of alignment"
    )
    search_growth: float = Field(
        default=1.9, ge=1, description="and those of sparse stereo's search"
    )
    threshold_share: float = Field(
        default=0.5, gt=0, le=1, description="so much less contrast must features have"
    )


class OdometrySettings(Settings):
    """The whole estimator; the defaults are the best that we know, `THESIS` is where it began."""

    seed: int = Field(default=0, ge=0, description="of RANSAC's samples")
    patience: int = Field(
        default=5,
        ge=0,
        description="lost frames after which the odometry starts anew, a young map sooner",
    )
    standing: Literal["none", "image", "encoders"] = Field(
        default="encoders",
        description="what tells that the rover stands (E11): nothing, flow, or wheels and flow",
    )
    features: FeatureSettings = FeatureSettings()
    matching: MatchingSettings = MatchingSettings()
    stereo: StereoSettings = StereoSettings()
    motion: MotionSettings = MotionSettings()
    refinement: RefinementSettings = RefinementSettings()
    faint: FaintSettings = FaintSettings()
    soft: SoftSettings = SoftSettings()


THESIS = OdometrySettings(
    standing="none",
    features=FeatureSettings(count=500, cell_px=10_000, smoothing_px=0),
    matching=MatchingSettings(
        predict="still", search_px=60, convincing=0, guided=False, align=False
    ),
    stereo=StereoSettings(method="block_matching", shrink=1, refine=False, least_disparity_px=8),
    motion=MotionSettings(
        solver="fischler_bolles",
        score="inliers",
        local_rounds=0,
        threshold=0.005,
        confidence=0.99,
        least_inliers=3,
    ),
    refinement=RefinementSettings(
        keyframe_parallax_px=0, sigma_px=0.5, sigma_disparity_px=0.5, learn_noise=False
    ),
    faint=FaintSettings(texture_to_noise=0),
    soft=SoftSettings(softness=0),
)
"""What the thesis did, and nothing more.

Stated there: 500 features (5.1.1), dense correlation stereo with a gate of 5 m (3.1), P3P after
Fischler and Bolles (2.6.2), most inliers within 0.005 in normalised coordinates (2.7, 5.4), going
on with three of them (5.1.1), refinement of points seen in three frames (4.4). Chosen by us,
because it gives no number: search window, confidence, window of refinement, noise.
"""
