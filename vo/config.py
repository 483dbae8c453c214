"""Settings of the estimator, each with its quantity, unit and default."""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from vo.contract.settings import Settings
from vo.renamed_settings import RENAMED


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError("must be odd")
    return value


PatchSide = Annotated[int, Field(ge=5, le=31), AfterValidator(_odd)]
"""Side of a square patch about a pixel, px."""

WindowScale = Annotated[
    float, Field(ge=1, description="factor on matching.align_px and stereo.align_px")
]
SearchScale = Annotated[float, Field(ge=1, description="factor on stereo.patch_px")]


class FeatureSettings(Settings):
    """CenSurE (thesis 3.2), or Harris corners for comparison."""

    detector: Literal["censure", "harris"] = "censure"
    """Feature detector."""
    kernel: Literal["box", "octagon", "star"] = "octagon"
    """Shape of CenSurE's centre and surround."""
    count: int = Field(default=800, ge=1)
    """Maximum number of features in an image."""
    threshold: float = Field(default=2.0, ge=0)
    """Minimum contrast of a feature, grey levels."""
    line_ratio: float = Field(default=12.0, gt=1)
    """Maximum ratio of the principal gradient energies."""
    smoothing_px: float = Field(default=0.8, ge=0)
    """Std. dev. of the Gaussian for noisy images, px; 0: none."""
    noise_threshold_grey: float = Field(default=3.5, ge=0)
    """Std. dev. of noise above which images are smoothed, grey."""
    min_distance_px: float = Field(default=5.0, ge=0)
    """Minimum distance of new landmarks to tracked ones, px."""
    cell_px: int = Field(default=40, ge=8)
    """Side of the image cells for bucketing of features, px."""


class MatchingSettings(Settings):
    """ZNCC with mutual nearest neighbours (thesis 3.2) and sub-pixel alignment."""

    patch_px: PatchSide = 13
    """Side of the correlated patch, px."""
    min_zncc: float = Field(default=0.75, gt=0, lt=1)
    """Minimum correlation of a match."""
    motion_model: Literal["constant_velocity", "constant_position"] = "constant_velocity"
    """Model that predicts the next pose."""
    search: Literal["features", "displacement"] = "displacement"
    """Landmarks are found among the features of each frame (thesis 3.2), or by displacement from
    the previous one: then features serve new landmarks, and frames where that fails."""
    probes: int = Field(default=100, ge=10)
    """Displacement: landmarks that give the first pose of a frame."""
    landmarks_per_frame: int = Field(default=300, ge=10)
    """Displacement: landmarks that give the pose of a frame that is no keyframe."""
    search_radius_px: float = Field(default=24.0, gt=0)
    """Half side of the search window at the prediction, px."""
    max_search_radius_px: float = Field(default=96.0, gt=0)
    """Half side of the search window without a prediction, px."""
    min_inlier_ratio: float = Field(default=0.22, ge=0, le=1)
    """Share of inliers of the landmarks in view below which other searches follow; 0: none do."""
    circular_check: bool = False
    """Matches must agree with the previous frame (F4)."""
    guided: bool = True
    """Match the remaining landmarks at their projections (F5)."""
    guided_quantile: float = Field(default=0.35, ge=0, le=1)
    """Quantile of the correlations of the other matches that a guided match needs."""
    align: bool = True
    """Align matches to sub-pixels by intensities."""
    align_px: PatchSide = 9
    """Side of the aligned patch, px."""
    min_align_zncc: float = Field(default=0.85, gt=0, lt=1)
    """Minimum correlation after alignment."""
    max_align_shift_px: float = Field(default=3.0, gt=0)
    """Maximum displacement of a feature by alignment, px."""
    max_zoom: float = Field(default=1.3, gt=1)
    """Change of scale above which a template is cut anew."""

    @model_validator(mode="after")
    def _guided_matches_are_aligned(self) -> Self:
        if self.guided and not self.align:
            raise ValueError("matching.guided needs matching.align")
        return self


class StereoSettings(Settings):
    """Sub-pixel disparity at the features, sparse or from a dense map (thesis 3.1)."""

    method: Literal["sparse", "block_matching", "semi_global"] = "sparse"
    """Stereo matching method."""
    patch_px: PatchSide = 9
    """Sparse: side of the correlated patch, px."""
    min_distinctness: float = Field(default=1.5, ge=1)
    """Sparse: minimum ratio of 1 - ZNCC, second best to best."""
    expected_search_radius_px: float = Field(default=3.0, gt=0)
    """Sparse: search radius at a predicted disparity, px."""
    downscale: int = Field(default=2, ge=1, le=4)
    """Dense: factor by which images are reduced."""
    max_disparity_px: float = Field(default=96.0, gt=0)
    """Maximum disparity of the search, px."""
    min_disparity_px: float = Field(default=1.0, ge=0)
    """Depth gate, px; 8 is 5.1 m with the default rig, as in thesis 3.1; 0: none."""
    refine: bool = True
    """Align the patches of the pair to sub-pixels."""
    align_px: PatchSide = 9
    """Side of the patch aligned across the pair, px."""
    min_align_zncc: float = Field(default=0.5, gt=0, lt=1)
    """Minimum left-right correlation after alignment."""
    max_sigma_px: float = Field(default=0.3, gt=0)
    """Maximum std. dev. of a disparity by image noise, px."""
    max_disagreement_px: float = Field(default=0.6, gt=0)
    """Maximum difference between shifted windows, px."""


class MotionSettings(Settings):
    """Pose estimation under RANSAC (thesis 2.6, 2.7, 3.3, 5.4)."""

    method: Literal["relative", "absolute", "decoupled", "graduated_nonconvexity"] = "relative"
    """Pose from landmarks and pixels (relative), from landmarks and points (absolute, 4.1), as
    rotation by far points before translation by near ones (decoupled, F6), or by refinement of
    the predicted pose without RANSAC (graduated_nonconvexity, F8)."""
    solver: Literal["fischler_bolles", "lambda_twist"] = "lambda_twist"
    """P3P solver of method relative."""
    scheme: Literal["adaptive", "preemptive"] = "adaptive"
    """RANSAC: sequential with adaptive stop, or preemptive."""
    score: Literal["inliers", "msac"] = "msac"
    """RANSAC: number of inliers, or truncated squared error."""
    residual: Literal["reprojection", "distance"] = "reprojection"
    """Error of a match; distance needs method absolute."""
    threshold: float = Field(default=0.003, gt=0)
    """Inlier threshold, normalised image coordinates (5.4)."""
    threshold_m: float = Field(default=0.05, gt=0)
    """Inlier threshold of residual distance, m."""
    confidence: float = Field(default=0.9999, gt=0, lt=1)
    """RANSAC: probability of an outlier-free sample."""
    max_hypotheses: int = Field(default=500, ge=1)
    """RANSAC: maximum samples; the number of them if preemptive."""
    local_iterations: int = Field(default=4, ge=0)
    """RANSAC: refits of each new best pose; 0: plain RANSAC."""
    landmark_prior: bool = False
    """Weight landmarks by their inlier history and prediction."""
    min_inliers: int = Field(default=8, ge=3)
    """Inliers below which a frame is lost."""
    weak_inliers: int = Field(default=25, ge=3)
    """Inliers below which a frame is weak."""
    weak_step_m: float = Field(default=0.001, ge=0)
    """Std. dev. of the step to a frame, or 2 % of the step if that is more, above which the frame
    is weak, m; 0: no limit."""
    weak_step_deg: float = Field(default=0.1, gt=0)
    """Likewise of its rotation, degrees."""

    @model_validator(mode="after")
    def _distances_need_points(self) -> Self:
        if self.residual == "distance" and self.method != "absolute":
            raise ValueError('motion.residual "distance" needs motion.method "absolute"')
        return self


class RefinementSettings(Settings):
    """Bundle adjustment (thesis 2.8, 3.4)."""

    mode: Literal["none", "motion", "window", "fixed_lag"] = "window"
    """Scope: none, the pose of every frame (motion), also the last keyframes with their landmarks
    (window), or these incrementally with marginalisation of older ones (fixed_lag)."""
    deferred: bool = True
    """A keyframe's landmarks are added one frame later, and the window is adjusted two later."""
    smooth: Literal["none", "window", "global"] = "window"
    """Smoothed trajectory at the end: none, by the last refinement of each keyframe (window), or by
    full-batch bundle adjustment (global)."""
    backend: Literal["schur", "gtsam"] = "schur"
    """Solver of a window: compiled elimination of the landmarks (schur), or GTSAM's stereo factors
    on keyframes and landmarks (gtsam), as always where smooth is global."""
    window: int = Field(default=8, ge=2)
    """Number of keyframes in the window."""
    exact_landmarks: bool = False
    """Whether landmarks count as exact for the pose of a frame, or by the error of their depth."""
    min_views: int = Field(default=3, ge=2)
    """Frames that must have seen a refined landmark (4.4)."""
    use_disparity: bool = True
    """Use disparities, or the left pixels alone as in eq. 2.29."""
    max_keyframe_iterations: int = Field(default=0, ge=0)
    """Iterations of a pose above which its frame is weak and no keyframe (5.3); 0: no limit."""
    map_reset_keyframes: int = Field(default=0, ge=0)
    """Keyframes after which all landmarks are triangulated anew (F7); 0: never."""
    sigma_px: float = Field(default=0.07, gt=0)
    """Std. dev. of u and v beside image noise, px."""
    sigma_disparity_px: float = Field(default=0.05, gt=0)
    """Std. dev. of the disparity beside image noise, px."""
    learn_noise: bool = True
    """Adapt both standard deviations to the residuals."""
    huber: float = Field(default=1.5, gt=0)
    """Residual at which the loss turns linear, standard deviations."""
    max_iterations: int = Field(default=15, ge=1)
    """Maximum number of Levenberg-Marquardt iterations."""
    keyframe_parallax_px: float = Field(default=15.0, ge=0)
    """Median flow since the last keyframe for a new one, px."""
    keyframe_tracked_ratio: float = Field(default=0.3, gt=0, le=1)
    """Tracked share of the keyframe's landmarks, weighted by squared disparity, below which a new
    one is made."""


class LowSnrSettings(Settings):
    """Adaptation to images whose texture hardly exceeds their noise."""

    texture_to_noise: float = Field(default=3.0, ge=0)
    """Energy of texture over that of noise below which an image is of low SNR; 0: never."""
    window_scale: WindowScale = 1.5
    search_scale: SearchScale = 1.9
    sigma_scale: float = Field(default=2.0, ge=1)
    """Factor on stereo.max_sigma_px."""


class DefocusSettings(Settings):
    """Adaptation to images that are out of focus."""

    softness: float = Field(default=3.3, ge=0)
    """Energy of grey differences over 4 px to those over 2 px, of which smooth images have 4, above
    which an image is out of focus; 0: never."""
    window_scale: WindowScale = 2.8
    search_scale: SearchScale = 1.9
    threshold_scale: float = Field(default=0.15, gt=0, le=1)
    """Factor on features.threshold."""


class OdometrySettings(Settings):
    """The whole estimator; the defaults are the most accurate choice, `THESIS` the original."""

    seed: int = Field(default=0, ge=0)
    """Random seed of RANSAC's samples."""
    patience_frames: int = Field(default=5, ge=0)
    """Lost frames after which a new map begins, or the age of the map where that is less."""
    stationary: Literal["none", "image", "encoders"] = "encoders"
    """Detection of standstill (E11): none, by optical flow (image), or by flow and wheels."""
    self_calibration: Literal["off", "auto"] = "auto"
    """Whether errors of the stereo calibration that rows show (rotation, delay of the right camera)
    are estimated, and corrected where significant (auto)."""
    budget_ms: float = Field(default=0, ge=0)
    """Time for a frame, ms, which then leaves out work and says which; 0: no limit."""
    features: FeatureSettings = FeatureSettings()
    matching: MatchingSettings = MatchingSettings()
    stereo: StereoSettings = StereoSettings()
    motion: MotionSettings = MotionSettings()
    refinement: RefinementSettings = RefinementSettings()
    low_snr: LowSnrSettings = LowSnrSettings()
    defocus: DefocusSettings = DefocusSettings()

    renamed: ClassVar[Mapping[str, str]] = RENAMED


THESIS = OdometrySettings(
    stationary="none",
    self_calibration="off",
    features=FeatureSettings(count=500, threshold=4.0, cell_px=10_000, smoothing_px=0),
    matching=MatchingSettings(
        motion_model="constant_position",
        search="features",
        search_radius_px=60,
        min_inlier_ratio=0,
        guided=False,
        align=False,
    ),
    stereo=StereoSettings(method="block_matching", downscale=1, refine=False, min_disparity_px=8),
    motion=MotionSettings(
        solver="fischler_bolles",
        score="inliers",
        local_iterations=0,
        threshold=0.005,
        confidence=0.99,
        min_inliers=3,
        weak_step_m=0,
    ),
    refinement=RefinementSettings(
        backend="gtsam",
        deferred=False,
        exact_landmarks=True,
        keyframe_parallax_px=0,
        sigma_px=0.5,
        sigma_disparity_px=0.5,
        learn_noise=False,
    ),
    low_snr=LowSnrSettings(texture_to_noise=0),
    defocus=DefocusSettings(softness=0),
)
"""The thesis, and nothing more.

Stated there: 500 features (5.1.1), dense correlation stereo with a gate of 5 m (3.1), P3P after
Fischler and Bolles (2.6.2), most inliers within 0.005 in normalised coordinates (2.7, 5.4), going
on with three of them (5.1.1), refinement of points seen in three frames (4.4). Chosen here,
because the thesis gives no number: search window, confidence, window of refinement, noise.
"""
