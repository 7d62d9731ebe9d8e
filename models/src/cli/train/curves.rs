//! Curves of a training's tables for its page.

use crate::report::plot::{Plot, Series};

/// Maximum number of points of a curve.
const POINTS: usize = 400;

/// A column of a table against the steps.
pub(super) fn column(rows: &[Vec<f64>], index: usize) -> Vec<(f64, f64)> {
    rows.iter().filter_map(|row| Some((*row.first()?, *row.get(index)?))).collect()
}

/// A curve, thinned.
pub(super) fn curve(label: &str, points: Vec<(f64, f64)>) -> Series {
    Series { label: label.into(), points: thinned(&points) }
}

/// Curves against the steps.
pub(super) fn plot(title: &str, y_label: &str, log_y: bool, series: Vec<Series>) -> Plot {
    Plot { title: title.into(), x_label: "step".into(), y_label: y_label.into(), log_y, series, reference: None }
}

/// Averages of neighbours where there are too many points.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let each = points.len().div_ceil(POINTS).max(1);
    let mean = |group: &[(f64, f64)]| {
        let (x, y) = group.iter().fold((0.0, 0.0), |(x, y), point| (x + point.0, y + point.1));
        (x / group.len() as f64, y / group.len() as f64)
    };
    points.chunks(each).map(mean).collect()
}
