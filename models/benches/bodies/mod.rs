//! Bodies that benches simulate.

/// So many points of a grid of 8 per cell, those nearest to a centre above the floor.
pub fn ball(count: usize, dx: f64) -> Vec<[f64; 3]> {
    let spacing = dx / 2.0;
    let radius = (3.0 * count as f64 / (4.0 * std::f64::consts::PI)).cbrt();
    let half = radius.ceil() as i64 + 1;
    let mut points: Vec<[i64; 3]> = Vec::new();
    for i in -half..half {
        for j in -half..half {
            points.extend((-half..half).map(|k| [i, j, k]));
        }
    }
    points.sort_by_key(|p| p.iter().map(|i| (2 * i + 1).pow(2)).sum::<i64>());
    points.truncate(count);
    let place = |p: [i64; 3]| -> [f64; 3] {
        let middle = [0.0, radius, 0.0];
        std::array::from_fn(|axis| (p[axis] as f64 + 0.5 + middle[axis]) * spacing + 0.1 * spacing)
    };
    points.into_iter().map(place).collect()
}
