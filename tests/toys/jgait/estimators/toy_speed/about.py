"""What the toy states about itself."""

from jgait.estimators.about import About, EstimateFigure, EstimateTable

FIGURES: tuple[EstimateFigure, ...] = ()

ABOUT = About(
    title="Distance at one speed",
    needs="waist_gyr_x … waist_acc_z.",
    tables=(EstimateTable("samples", "samples"),),
    figures=FIGURES,
)
