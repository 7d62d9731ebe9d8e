//! The two matrices of a camera entry: camera to world, and intrinsics.

use serde_json::Value;

/// Maximum deviation of `R Rᵀ` from the identity, which allows for rotations written with few digits.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// Maximum deviation of a last row from `0 … 0 1`, which allows for single-precision matrix products.
const LAST_ROW_TOLERANCE: f64 = 1e-5;

/// Focal lengths and principal point \[pixels\].
pub(super) type Intrinsic = [f64; 4];

/// Reads the matrix called `name`, 3×4 (a fourth row 0 0 0 1 is accepted), and checks that it is a rigid motion.
pub(super) fn camera_to_world(value: &Value, name: &str) -> Result<[[f64; 4]; 3], String> {
    let rows = rows(value, name)?;
    let fits = matches!(rows.len(), 3 | 4) && rows.iter().all(|row| row.len() == 4);
    if !fits {
        return Err(format!("{name} is {}, not 3×4", size(&rows)));
    }
    if let Some(row) = rows.get(3).filter(|row| !is_last(row)) {
        return Err(format!("{name} has the fourth row {row:?}, not 0 0 0 1"));
    }
    let c2w = [0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| rows[i][j]));
    let dot = |a: usize, b: usize| (0..3).map(|k| c2w[a][k] * c2w[b][k]).sum::<f64>();
    for a in 0..3 {
        for b in 0..3 {
            let wanted = if a == b { 1.0 } else { 0.0 };
            if (dot(a, b) - wanted).abs() > ROTATION_TOLERANCE {
                return Err(format!(
                    "{name} is not a rotation and a translation: rows {a} and {b} have dot product {}",
                    dot(a, b)
                ));
            }
        }
    }
    let m = |i: usize, j: usize| c2w[i][j];
    let det = m(0, 0) * (m(1, 1) * m(2, 2) - m(1, 2) * m(2, 1)) - m(0, 1) * (m(1, 0) * m(2, 2) - m(1, 2) * m(2, 0))
        + m(0, 2) * (m(1, 0) * m(2, 1) - m(1, 1) * m(2, 0));
    if det < 0.0 {
        return Err(format!("{name} mirrors space: its determinant is negative"));
    }
    Ok(c2w)
}

/// Reads the matrix called `name`, 3×3 with rows `fx 0 cx`, `0 fy cy`, `0 0 1`.
pub(super) fn intrinsic(value: &Value, name: &str) -> Result<Intrinsic, String> {
    let rows = rows(value, name)?;
    if rows.len() != 3 || rows.iter().any(|row| row.len() != 3) {
        return Err(format!("{name} is {}, not 3×3", size(&rows)));
    }
    let [fx, fy] = [rows[0][0], rows[1][1]];
    if fx <= 0.0 || fy <= 0.0 {
        return Err(format!("focal lengths must be positive, found {fx} and {fy}"));
    }
    if rows[0][1].abs() > 1e-6 * fx || rows[1][0].abs() > 1e-6 * fx || !is_last(&rows[2]) {
        return Err(format!("{name} has entries besides fx, fy, cx, cy; skew is not supported"));
    }
    Ok([fx, fy, rows[0][2], rows[1][2]])
}

/// Whether a row is `0 … 0 1`.
fn is_last(row: &[f64]) -> bool {
    let last = row.len() - 1;
    (0..).zip(row).all(|(at, x)| (x - f64::from(u8::from(at == last))).abs() <= LAST_ROW_TOLERANCE)
}

fn rows(value: &Value, name: &str) -> Result<Vec<Vec<f64>>, String> {
    let rows = value.as_array().ok_or_else(|| format!("{name} is not a list of rows"))?;
    rows.iter()
        .map(|row| {
            let row = row.as_array().ok_or_else(|| format!("{name} is not a list of rows"))?;
            row.iter()
                .map(|entry| match entry.as_f64() {
                    Some(number) if number.is_finite() => Ok(number),
                    _ => Err(format!("{name} holds {entry}, which is not a finite number")),
                })
                .collect()
        })
        .collect()
}

fn size(rows: &[Vec<f64>]) -> String {
    let columns: Vec<usize> = rows.iter().map(Vec::len).collect();
    match columns.as_slice() {
        [] => "empty".into(),
        [first, rest @ ..] if rest.iter().all(|n| n == first) => format!("{}×{first}", rows.len()),
        _ => format!("ragged (rows of {columns:?} numbers)"),
    }
}
