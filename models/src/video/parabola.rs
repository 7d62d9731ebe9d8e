//! A parabola in time, as a body in free flight moves in the picture.

/// Gravity \[m/s²\].
pub(crate) const GRAVITY: f64 = 9.81;

/// A parabola `x(t) = x₀ + v τ + ½ a τ²` with `τ = t − t₀`, in pixels and seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Parabola {
    /// Reference time \[s\].
    pub time: f64,
    /// Position at that time \[pixels\].
    pub place: [f64; 2],
    /// Velocity at that time \[pixels/s\].
    pub velocity: [f64; 2],
    /// Acceleration \[pixels/s²\].
    pub acceleration: [f64; 2],
    /// Root mean square distance of the fitted positions \[pixels\].
    pub scatter: f64,
    /// Standard deviation of the vertical acceleration for a scatter of one pixel \[1/s²\].
    pub leverage: f64,
}

/// Moments of times about their mean.
#[derive(Clone, Copy)]
struct Moments {
    count: f64,
    time: f64,
    s2: f64,
    s3: f64,
    s4: f64,
    /// Sum of the squares of [`Moments::curve`].
    strength: f64,
}

impl Moments {
    fn of(times: impl Iterator<Item = f64> + Clone) -> Self {
        let count = times.clone().count() as f64;
        let time = times.clone().sum::<f64>() / count;
        let moment = |power: i32| times.clone().map(|t| (t - time).powi(power)).sum::<f64>();
        let (s2, s3, s4) = (moment(2), moment(3), moment(4));
        Self { count, time, s2, s3, s4, strength: 0.25 * (s4 - s2 * s2 / count - s3 * s3 / s2) }
    }

    /// The quadratic part of a parabola that is orthogonal to constant and linear parts.
    fn curve(&self, t: f64) -> f64 {
        0.5 * ((t - self.time).powi(2) - self.s2 / self.count - self.s3 / self.s2 * (t - self.time))
    }

    /// Whether the times determine an acceleration.
    fn bend(&self) -> bool {
        self.count >= 3.0 && self.s2 > 0.0 && self.strength > 1e-9 * self.s4
    }
}

impl Parabola {
    /// Position at a time \[pixels\].
    pub fn at(&self, time: f64) -> [f64; 2] {
        let t = time - self.time;
        [0, 1].map(|c| self.place[c] + self.velocity[c] * t + 0.5 * self.acceleration[c] * t * t)
    }

    /// Velocity at a time \[pixels/s\].
    pub fn velocity_at(&self, time: f64) -> [f64; 2] {
        [0, 1].map(|c| self.velocity[c] + self.acceleration[c] * (time - self.time))
    }

    /// The least squares fit of positions at times; with a given acceleration, of place and velocity alone.
    /// `None` if the times do not determine it.
    pub fn fit(points: &[(f64, [f64; 2])], acceleration: Option<[f64; 2]>) -> Option<Self> {
        let moments = Moments::of(points.iter().map(|(t, _)| *t));
        let Moments { count, time, s2, s3, strength, .. } = moments;
        if points.len() < 2 || s2 <= 0.0 || acceleration.is_none() && !moments.bend() {
            return None;
        }
        let mut found = Self {
            time,
            place: [0.0; 2],
            velocity: [0.0; 2],
            acceleration: acceleration.unwrap_or_default(),
            scatter: 0.0,
            leverage: 1.0 / strength.max(f64::MIN_POSITIVE).sqrt(),
        };
        for c in 0..2 {
            let mean = points.iter().map(|(_, p)| p[c]).sum::<f64>() / count;
            let slope = points.iter().map(|(t, p)| (t - time) * p[c]).sum::<f64>() / s2;
            let bend = match acceleration {
                Some(given) => given[c],
                None => points.iter().map(|(t, p)| moments.curve(*t) * p[c]).sum::<f64>() / strength,
            };
            found.acceleration[c] = bend;
            found.place[c] = mean - 0.5 * bend * s2 / count;
            found.velocity[c] = slope - 0.5 * bend * s3 / s2;
        }
        let off = |(t, p): &(f64, [f64; 2])| {
            let at = found.at(*t);
            (at[0] - p[0]).powi(2) + (at[1] - p[1]).powi(2)
        };
        let parameters = if acceleration.is_some() { 2.0 } else { 3.0 };
        let free = (count - parameters).max(1.0);
        found.scatter = (points.iter().map(off).sum::<f64>() / (2.0 * free)).sqrt();
        Some(found)
    }

    /// Weights of positions at these times: their weighted sum is the acceleration of the fit. `None` if the times do not determine it.
    pub fn weights(times: &[f64]) -> Option<Vec<f64>> {
        let moments = Moments::of(times.iter().copied());
        moments.bend().then(|| times.iter().map(|t| moments.curve(*t) / moments.strength).collect())
    }

    /// The time at which two flights of the same acceleration are at one height, and their distance then.
    pub fn meets(&self, next: &Self) -> Option<(f64, f64)> {
        // with equal accelerations the difference of the heights is linear in time
        let about = 0.5 * (self.time + next.time);
        let apart = self.at(about)[1] - next.at(about)[1];
        let rate = self.velocity_at(about)[1] - next.velocity_at(about)[1];
        if rate.abs() < 1e-9 {
            return None;
        }
        let time = about - apart / rate;
        let (a, b) = (self.at(time), next.at(time));
        Some((time, (a[0] - b[0]).hypot(a[1] - b[1])))
    }
}
