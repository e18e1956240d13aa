"""What the toy states about itself."""

from jgait.estimators.about import About, EstimateFigure, EstimateTable, TotalColumn

FIGURES: tuple[EstimateFigure, ...] = ()

ABOUT = About(
    title="Distance at one speed",
    needs="waist_gyr_x … waist_acc_z.",
    totals=lambda estimate: [{"distance_m": float(estimate.distance[-1])}],
    columns=(TotalColumn("distance_m", "distance", "m"),),
    tables=(EstimateTable("samples", "samples"),),
    figures=FIGURES,
)
