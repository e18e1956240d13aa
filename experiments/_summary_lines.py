"""The lines of the summary: which metrics of which experiment stand beside which figure of a paper.

A cell is a format string over the metrics of its experiment: `{distance_error_pct:.1f}` is a value,
`{distance_error_pct.n}` what it is made of, `{distance_error_pct.paper:g}` the paper's figure; `.cm`, `.ms` and `.pct`
are the same in centimetres, milliseconds and per cent. `{least[a,b]:.1f}` and `{most[a,b]:.1f}` choose among metrics,
`{total[a,b]}` adds up what they are made of.
"""

from typing import NamedTuple


class Line(NamedTuple):
    """A line of the table.

    Attributes:
        label: what was measured, with its unit.
        experiment: the name of the script that measures it.
        n: how many walks, people or strides; first simulation's, then the recordings'.
        paper: the paper's figure.
        simulated: ours in simulation.
        real: ours on real recordings.
    """

    label: str
    experiment: str
    n: str
    paper: str = "–"
    simulated: str = "–"
    real: str = "–"


def _both(metric: str, unit: str, digits: int = 1) -> str:
    """Right / left of a metric of a walk."""
    return f"{{{metric}_{unit}_right:.{digits}f}} / {{{metric}_{unit}_left:.{digits}f}}"


def _joints(walk: str) -> str:
    return f"{_both(f'{walk}_hip', 'deg')}, {_both(f'{walk}_knee', 'deg')}"


def _foot(walk: str) -> str:
    return f"{_both(f'{walk}_x', 'cm')}, {_both(f'{walk}_y', 'cm')}"


def _of_mobgap(name: str, what: str, ends: str = "") -> str:
    """The same metric of each of mobgap's detectors of contacts, and of the further parts `ends`."""
    parts = [f"{name}_mobgap_{one}" for one in ("ionescu", "shin", "hklee")]
    return f"{what}[{','.join(part + end for part in parts for end in ends.split(','))}]"


LEG = (
    Line("paper's pipeline, straight: hip, knee [°]", "leg_ekf", "1 walk", real=_joints("paper_straight")),
    Line("paper's pipeline, straight: foot x [cm]", "leg_ekf", "1 walk", real=_both("paper_straight_x", "cm")),
    Line("paper's pipeline, with the U-turn: hip, knee [°]", "leg_ekf", "1 walk", real=_joints("paper_whole")),
    Line("default, straight: hip, knee [°]", "leg_ekf", "1 walk", real=_joints("default_straight")),
    Line("default, straight: foot x, y [cm]", "leg_ekf", "1 walk", real=_foot("default_straight")),
    Line("default, with the U-turn: hip, knee [°]", "leg_ekf", "1 walk", real=_joints("default_whole")),
    Line("default, with the U-turn: foot x, y [cm]", "leg_ekf", "1 walk", real=_foot("default_whole")),
    Line("the same, standing pose known: foot y [cm]", "leg_ekf", "1 walk", real=_both("known_pose_whole_y", "cm")),
    Line(
        "paper's pipeline, scale from other people in simulation: distance error [%]",
        "leg_ekf",
        "{sim_paper_calibrated_distance_error_pct.n} people; 1 walk",
        "{sim_paper_calibrated_distance_error_pct.paper:g}",
        "{sim_paper_calibrated_distance_error_pct:.1f}",
        "{paper_straight_distance_error_pct:.1f} (straight, no scale)",
    ),
    Line(
        "paper's pipeline, scale from other people: displacement RMSE [cm]",
        "leg_ekf",
        "{sim_paper_calibrated_displacement_rmse_cm.n} people",
        "{sim_paper_calibrated_displacement_rmse_cm.paper:.2f}",
        "{sim_paper_calibrated_displacement_rmse_cm:.1f}",
    ),
    Line(
        "default, tuned on the walk out, judged on the walk back: distance error [%]",
        "leg_ekf",
        "1 walk",
        real="{heldout_distance_error_pct:.1f}",
    ),
    Line(
        "default, scale from other people: distance error [%], mean (median, worst)",
        "leg_ekf",
        "{sim_distance_error_pct.n}; {walking5m_loso_distance_mae_pct.n} people",
        simulated="{sim_distance_error_pct:.1f}",
        real="{walking5m_loso_distance_mae_pct:.1f} ({walking5m_loso_distance_median_pct:.1f}, "
        "{walking5m_loso_distance_worst_pct:.1f})",
    ),
    Line(
        "default, scale from other people: displacement RMSE [cm]",
        "leg_ekf",
        "{sim_displacement_rmse_cm.n} people",
        "{sim_displacement_rmse_cm.paper:.2f}",
        "{sim_displacement_rmse_cm:.1f}",
    ),
    Line(
        "default, scale and roll-over radius tuned on other people, against untuned: distance error [%], median "
        "(worst)",
        "tuning",
        "{walking5m_distance_error_after_median.n} people",
        real="{walking5m_distance_error_after_median:.1f} ({walking5m_distance_error_after_worst:.1f}), against "
        "{walking5m_distance_error_before_median:.1f} ({walking5m_distance_error_before_worst:.1f})",
    ),
    Line(
        "gyroscopes alone, noise and standing pose tuned on other people, against untuned: error of angles and path "
        "[°² + cm²], median (worst)",
        "tuning",
        "{loso_error_after_median.n} people",
        simulated="{loso_error_after_median:.1f} ({loso_error_after_worst:.1f}), against "
        "{loso_error_before_median:.1f} ({loso_error_before_worst:.1f})",
    ),
    Line(
        "noise scales by likelihood, from data drawn from the model: largest error [%]",
        "tuning",
        "{recover_noise_rel_error_max.n} legs",
        simulated="{recover_noise_rel_error_max.pct:.1f}",
    ),
    Line(
        "everybody's own thigh and shank length from the path of the foot: error [cm], median (worst)",
        "tuning",
        "{recover_leg_length_whole_cm_median.n} people",
        simulated="{recover_leg_length_cm_median:.2f} ({recover_leg_length_cm_worst:.2f})",
    ),
    Line(
        "default, own leg lengths, walks of a minute: distance error [%], median (worst)",
        "cohort",
        "{distance_error_median_pct.n:,} people",
        simulated="{distance_error_median_pct:.2f} ({distance_error_worst_pct:.1f})",
    ),
)

SIMULATOR = (
    Line(
        "the simulator: a perfect sensor integrated for 60 s at 200 Hz, worst of its places [mm]",
        "simulator",
        "{strapdown_position_error_mm_60s.n} sensors",
        simulated="{strapdown_position_error_mm_60s:.1f}",
    ),
    Line(
        "the same, fitted to its own noisy signals: stride length, mean error (worst) [cm]",
        "simulator",
        "{fit_stride_length_error_cm.n} people",
        simulated="{fit_stride_length_error_cm:.1f} ({fit_stride_length_error_cm_worst:.1f})",
    ),
    Line(
        "the same, figures of gait within the 5 to 95 % of real strides or people [%]",
        "simulator",
        "{figures_inside_share.n} figures",
        real="{figures_inside_share.pct:.0f}",
    ),
)

_STRIDE = "{{foot_stride_mae_cm_{0}:.2f}} ({{foot_stride_worst_cm_{0}:.1f}})"
_PEER = "{{gaitmap_stride_mae_cm_{0}:.1f}}"

FOOT = (
    Line(
        "feet (`foot_ins`), defaults: stride length, MAE (worst) [cm]: `gaitmap_example`",
        "foot_ins",
        "{sim_straight_stride_mae_cm.n}; {foot_stride_mae_cm_gaitmap_example.n} strides",
        simulated="{sim_straight_stride_mae_cm:.1f} ({sim_straight_stride_worst_cm:.1f})",
        real=f"{_STRIDE.format('gaitmap_example')}; gaitmap's filter {_PEER.format('gaitmap_example')}",
    ),
    Line(
        "the same: `neura_sparse`",
        "foot_ins",
        "{foot_stride_mae_cm_neura_sparse.n} strides",
        real=f"{_STRIDE.format('neura_sparse')}; gaitmap's {_PEER.format('neura_sparse')}, bias taken off "
        "{gaitmap_unbiased_stride_mae_cm_neura_sparse:.1f}",
    ),
    Line(
        "the same: `footprints`, default pivot (learned on the other walk)",
        "foot_ins",
        "{foot_stride_mae_cm_footprints.n} strides",
        real=f"{_STRIDE.format('footprints')} ({{foot_stride_mae_cm_footprints_calibrated:.2f}}); gaitmap's "
        f"{_PEER.format('footprints')}, bias taken off {{gaitmap_unbiased_stride_mae_cm_footprints:.1f}}",
    ),
    Line(
        "the same: `pyshoe_vicon`",
        "foot_ins",
        "{foot_stride_mae_cm_pyshoe_vicon.n} strides",
        real=f"{_STRIDE.format('pyshoe_vicon')}, of it {{foot_stride_bias_cm_pyshoe_vicon:.1f}} bias; gaitmap's "
        f"{_PEER.format('pyshoe_vicon')}",
    ),
)

WIDTH = (
    Line(
        "stride width, EKF as the paper's, range made from markers: MAE [cm] ([%] of the width)",
        "stride_width_ekf",
        "{sim_ekf_width_mae_cm.n}; {width_mae_cm_ekf.n} strides, each from 6 starts",
        "< {width_mae_pct_ekf.paper:g} %",
        "{sim_ekf_width_mae_cm:.1f}",
        "{width_mae_cm_ekf:.1f} ({width_mae_pct_ekf:.1f})",
    ),
    Line(
        "stride width, default (RTS): MAE (worst) [cm]",
        "stride_width_ekf",
        "the same",
        simulated="{sim_width_mae_cm:.1f}",
        real="{width_mae_cm_rts:.2f} ({width_worst_cm_rts:.1f})",
    ),
    Line(
        "stride width, one filter on both feet's raw signals: MAE (worst) [cm]",
        "stride_width_ekf",
        "{sim_joint_width_mae_cm.n}; {width_mae_cm_joint.n}",
        simulated="{sim_joint_width_mae_cm:.1f}",
        real="{width_mae_cm_joint:.2f} ({width_worst_cm_joint:.1f})",
    ),
    Line(
        "the paper's walk, RTS: mean error of z₁ in three sections [cm]",
        "stride_width_ekf",
        "{sim_z1_mean_m_section1.n} people",
        ", ".join(f"{{sim_z1_mean_m_section{part}.paper.cm:.1f}}" for part in (1, 2, 3)),
        ", ".join(f"{{sim_z1_mean_m_section{part}.cm:.1f}}" for part in (1, 2, 3)),
    ),
    Line(
        "the same: SD of z₂ behind the corner [cm]",
        "stride_width_ekf",
        "{sim_z2_sd_m_section3.n} people",
        "{sim_z2_sd_m_section3.paper.cm:.1f}",
        "{sim_z2_sd_m_section3.cm:.1f}",
    ),
)

_SETS = ("tripod", "neura_ankle", "neura_shank", "walking5m")
_TURNED = ",".join(f"rotation25_{name}_filter_change_cm" for name in _SETS)
_TURNED_LI = ",".join(f"rotation25_{name}_li_change_cm" for name in _SETS)

ANKLE = (
    Line(
        "ankle (`ankle_stride`): strides counted, error [%], mean (worst)",
        "ankle_stride",
        "{sim_count_error_pct.n} walks; {f1_strict_pooled.n} strides",
        "{sim_count_error_pct.paper:g}",
        "{sim_count_error_pct:.1f} ({sim_count_error_pct_max:.1f})",
        "F1 {f1_strict_pooled:.3f} (half-steps included)",
    ),
    Line(
        "the same: distance, filter, error [%], mean (worst)",
        "ankle_stride",
        "{sim_distance_filter_error_pct.n} walks; {tripod_distance_error_pct.n} legs",
        "1.2, 3.7 (3-D)",
        "{sim_distance_filter_error_pct:.1f} ({sim_distance_filter_error_pct_max:.1f}); 3-D "
        "{sim_distance_error_pct:.1f} ({sim_distance_error_pct_max:.1f})",
        "{tripod_distance_error_pct:.1f} ({tripod_distance_error_pct_max:.1f}) `tripod`",
    ),
    Line(
        "the same, lever learned on others: stride length, MAE [cm]: `tripod`, against OptoGait",
        "ankle_stride",
        "{tripod_stride_mae_cm.n} strides",
        real="{tripod_stride_mae_cm:.1f}; Li's 2-D {tripod_li_mae_cm:.1f}",
    ),
    Line(
        "the same: `neura_sparse`, ankle, mid shank",
        "ankle_stride",
        "{neura_ankle_stride_mae_cm.n}, {neura_shank_stride_mae_cm.n} strides",
        real="{neura_ankle_stride_mae_cm:.1f}, {neura_shank_stride_mae_cm:.1f}; Li's {neura_ankle_li_mae_cm:.0f}, "
        "{neura_shank_li_mae_cm:.0f}",
    ),
    Line(
        "the same: `walking5m`, against foot trajectories that err by 4 to 6 cm",
        "ankle_stride",
        "{walking5m_stride_mae_cm.n} strides",
        real="{walking5m_stride_mae_cm:.1f}; Li's {walking5m_li_mae_cm:.1f}",
    ),
    Line(
        "the same: change of a stride as the sensor turns by 25° [cm]",
        "ankle_stride",
        f"{{total[{_TURNED}]}} strides",
        "67–78 % less than Li's",
        real=f"{{most[{_TURNED}]:.2f}}; Li's {{least[{_TURNED_LI}]:.0f}} to {{most[{_TURNED_LI}]:.0f}}",
    ),
)

_F1_PEERS = [_of_mobgap(f"ic_f1_{name}", "most") for name in ("mobgap_lab", "ipol_gait")]
_MAE_PEERS = [_of_mobgap(f"ic_mae_ms_{name}", "least") for name in ("mobgap_lab", "ipol_gait")]
_LAB_PEERS = [_of_mobgap("distance_mae_pct_mobgap_lab", what, "_ms_all,_ms_ms") for what in ("least", "most")]
_DISTANCE = "{{distance_mae_pct_{0}:.1f}} ({{distance_median_pct_{0}:.1f}}, {{distance_worst_pct_{0}:.1f}})"

WAIST = (
    Line(
        "waist (`waist_ofdri`), initial contacts, straight walks: F1, left/right right [%]: `mobgap_lab`, `ipol_gait`",
        "waist_ofdri",
        "{sim_ic_f1.n}; {ic_f1_mobgap_lab.n}, {ic_f1_ipol_gait.n} contacts",
        "{sim_hs_detected_pct.paper:g} % found",
        "{sim_hs_detected_pct:.0f} % found, F1 {sim_ic_f1:.2f}",
        "{ic_f1_mobgap_lab:.2f}, {ic_f1_ipol_gait:.2f}; {ic_side_pct_mobgap_lab:.0f}, {ic_side_pct_ipol_gait:.0f}; "
        f"mobgap's best {{{_F1_PEERS[0]}:.2f}}, {{{_F1_PEERS[1]}:.2f}}",
    ),
    Line(
        "the same, offset learned on other people: MAE [ms]",
        "waist_ofdri",
        "{sim_hs_error_mean_s.n}; {ic_mae_ms_mobgap_lab.n}, {ic_mae_ms_ipol_gait.n} contacts",
        "{sim_hs_error_mean_s.paper.ms:.0f} ± {sim_hs_error_sd_s.paper.ms:.0f}",
        "{sim_hs_error_mean_s.ms:.0f} ± {sim_hs_error_sd_s.ms:.0f}",
        "{ic_mae_ms_mobgap_lab:.0f}, {ic_mae_ms_ipol_gait:.0f}; "
        f"mobgap's best {{{_MAE_PEERS[0]}:.0f}}, {{{_MAE_PEERS[1]}:.0f}}",
    ),
    Line(
        "distance, constant learned on other people: error [%], mean (median, worst): `ipol_gait` straight",
        "waist_ofdri",
        "{sim_fused_distance_error_pct.n}; {distance_mae_pct_ipol_straight.n} people",
        simulated="{sim_fused_distance_error_pct:.1f} (–, {sim_fused_distance_error_pct_max:.1f})",
        real=f"{_DISTANCE.format('ipol_straight')}; mobgap's best "
        f"{{{_of_mobgap('distance_mae_pct_ipol_straight', 'least', '_ms_all,_ms_ms')}:.1f}}",
    ),
    Line(
        "the same: `ipol_gait` with the U-turn",
        "waist_ofdri",
        "{distance_mae_pct_ipol_whole.n} people",
        real=_DISTANCE.format("ipol_whole"),
    ),
    Line(
        "the same: `mobgap_lab`",
        "waist_ofdri",
        "{distance_mae_pct_mobgap_lab.n} walks of 2 people",
        real=f"{_DISTANCE.format('mobgap_lab')}; mobgap's {{{_LAB_PEERS[0]}:.1f}} to {{{_LAB_PEERS[1]}:.1f}}",
    ),
    Line(
        "the paper's way (OFDRI, velocity update), straight: distance error [%], mean (median, worst)",
        "waist_ofdri",
        "{sim_distance_printed_error_pct.n}; {distance_mae_pct_ipol_straight_update.n} people",
        "{sim_distance_printed_error_pct.paper:g}",
        "{sim_distance_printed_error_pct:.1f}; from true accelerations {sim_distance_true_acc_printed_error_pct:.1f}, "
        "with ε learned {sim_distance_true_acc_error_pct:.1f}",
        _DISTANCE.format("ipol_straight_update"),
    ),
    Line(
        "the same without update; forward integration alone [%]",
        "waist_ofdri",
        "{sim_distance_frozen_error_pct.n}; {distance_mae_pct_ipol_straight_frozen.n} people",
        "{sim_distance_frozen_error_pct.paper:g}; {sim_distance_integrated_error_pct.paper:g}",
        "{sim_distance_frozen_error_pct:.0f}; {sim_distance_integrated_error_pct:.0f}",
        "{distance_mae_pct_ipol_straight_frozen:.0f}; {distance_mae_pct_ipol_straight_integrated:.0f}",
    ),
)

DUTY = (
    Line(
        "gyroscope asleep part of the time: energy saved at nine schedules [%], largest difference",
        "duty_cycled_gyro",
        "{energy_column_max_error.n} schedules",
        "Table 2",
        "{energy_column_max_error:.3f}",
    ),
    Line(
        "the same, gaps filled from the accelerometer (`gap_filling`, neighbours), `tripod` shank, first 14 s: error "
        "at 40 and 10 % of the time, over the signal",
        "duty_cycled_gyro",
        "{simulation_neighbours_duty40.n} people; {tripod_err_duty40.n} legs",
        "{tripod_err_duty40.paper:.2f}, {tripod_err_duty10.paper:.2f}",
        "{simulation_neighbours_duty40:.2f}, {simulation_neighbours_duty10:.2f}",
        "{tripod_err_duty40:.2f}, {tripod_err_duty10:.2f} ({tripod_err_duty40_untuned:.3f}, "
        "{tripod_err_duty10_untuned:.3f} at the speed not tuned on)",
    ),
    Line(
        "the same, `walking5m`, with the thigh's sensor (blend): at 50 and 10 %, median (worst)",
        "duty_cycled_gyro",
        "{walking5m_median_err_duty50.n} legs",
        real="{walking5m_median_err_duty50:.2f} ({walking5m_worst_err_duty50:.2f}), {walking5m_median_err_duty10:.2f} "
        "({walking5m_worst_err_duty10:.2f})",
    ),
    Line(
        "the same, `neura_sparse`",
        "duty_cycled_gyro",
        "{neura_sparse_blend_duty50.n} sensors",
        real="{neura_sparse_blend_duty50:.2f}, {neura_sparse_blend_duty10:.2f}",
    ),
    Line(
        "schedules found by gradient on the young of `walking5m`, judged on its elderly: error where 70, 45, 17 % of "
        "the energy are saved",
        "duty_cycled_gyro",
        "{front_walking5m_price0_5_error.n} legs",
        real="{front_walking5m_price0_5_error:.2f}, {front_walking5m_price0_25_error:.2f}, "
        "{front_walking5m_price0_12_error:.2f}",
    ),
    Line(
        "a gyroscope woken when the filler doubts itself, tuned on the young, judged on the elderly: energy saved "
        "against the best fixed schedule at an error of 0.10 [%]",
        "duty_cycled_gyro",
        "{triggered_energy_saving_pct.n} legs",
        real="{triggered_energy_saving_pct:.1f}; on a treadmill (error 0.05) {triggered_tripod_energy_saving_pct:.0f}",
    ),
    Line(
        "knee of `leg_ekf`, `neura_sparse`, shank's gyroscope on for 50, 20 %: degrees lost after the U-turn (with it)",
        "duty_cycled_gyro",
        "1 walk, {joint_knee_deg_lost_duty50.n} legs",
        real="{joint_knee_deg_lost_straight_duty50:.1f}, {joint_knee_deg_lost_straight_duty20:.1f} "
        "({joint_knee_deg_lost_duty50:.1f}, {joint_knee_deg_lost_duty20:.1f})",
    ),
)

LINES = LEG + FOOT + WIDTH + ANKLE + WAIST + DUTY + SIMULATOR
