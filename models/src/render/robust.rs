//! The pixel loss: squared, or robust for imagined views, which may be misregistered by a few pixels.

use gradreel::Var;

/// The loss of a residual.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PixelLoss {
    /// Whether residuals of imagined views use [`huber`] instead of the square.
    pub robust: bool,
    /// Residual beyond which the loss of an imagined view is linear, in units of colour.
    pub delta: f64,
}

impl Default for PixelLoss {
    fn default() -> Self {
        Self { robust: true, delta: 0.1 }
    }
}

/// `r²` up to `|r| = delta`, and `2 delta |r| − delta²` beyond: value and slope are continuous (Huber 1964, times two).
#[must_use]
pub fn huber(residual: &Var, delta: f64) -> Var {
    residual.map("huber", |r| {
        let size = r.abs();
        size.gt(delta).select(size * (2.0 * delta) - delta * delta, r * r)
    })
}

impl PixelLoss {
    /// The loss of each residual of a real or imagined view.
    #[must_use]
    pub fn of(&self, residual: &Var, imagined: bool) -> Var {
        if self.robust && imagined { huber(residual, self.delta) } else { residual.square() }
    }
}
