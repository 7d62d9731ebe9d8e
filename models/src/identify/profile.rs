//! How far a loss stays low along a parameter, whatever its curvature where a search ended: the check of an interval.

use gradreel::{ErrorKind, Result};

/// A valley of the loss as its curvature has it: along a parameter, the others moved with it as they follow.
#[derive(Debug, Clone)]
pub(super) struct Valley {
    /// The way, in the coordinates of all free unknowns, for one unit of distance.
    pub way: Vec<f64>,
    /// How far the end of the interval is that the pictures alone tell.
    pub end: f64,
    /// How much higher the loss is there, if it is curved as it looks.
    pub rise: f64,
    /// How far it is worth looking: to the end of what is plausible.
    pub farthest: f64,
}

/// A loss that has risen by this share of what its curvature promised is taken to have risen.
const RISEN: f64 = 0.8;

/// Looks at most, to each side.
const LOOKS: usize = 4;

/// How much farther a look goes than the one before, at least and at most.
const FARTHER: [f64; 2] = [1.3, 2.5];

impl Valley {
    /// How many times farther than the curvature says the loss stays as low as at the end of the interval, to whichever side that is more;
    /// at least 1. `loss` is the loss at a distance, above that at the middle.
    ///
    /// # Errors
    /// What `loss` returns, but for simulations that break down: there is an end there.
    pub fn wider(&self, loss: &mut dyn FnMut(&[f64]) -> Result<f64>) -> Result<f64> {
        let mut farthest = self.end;
        for sign in [-1.0, 1.0] {
            let mut far = self.end;
            for _ in 0..LOOKS {
                let there: Vec<f64> = self.way.iter().map(|way| sign * far * way).collect();
                let rise = match loss(&there) {
                    Err(error) if error.kind() == ErrorKind::Physics => break,
                    rise => rise?,
                };
                if rise.is_nan() || rise >= RISEN * self.rise || far >= self.farthest {
                    break;
                }
                // as a parabola through this point has it
                let ratio = (self.rise / rise.max(f64::MIN_POSITIVE)).sqrt();
                far = (far * ratio.clamp(FARTHER[0], FARTHER[1])).min(self.farthest);
            }
            farthest = farthest.max(far);
        }
        Ok(farthest / self.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_valley_flatter_than_it_looks_is_wider() {
        let valley = Valley { way: vec![2.0, 0.5], end: 0.1, rise: 1.0, farthest: 1.0 };
        // as it looks: 100 far²
        let mut looks = 0;
        let wider = valley.wider(&mut |x| {
            looks += 1;
            assert!((x[0] - 4.0 * x[1]).abs() < 1e-12);
            Ok(25.0 * x[0] * x[0])
        });
        assert_eq!((wider.unwrap(), looks), (1.0, 2));
        // a quarter of the curvature: twice as wide
        let wider = valley.wider(&mut |x| Ok(6.25 * x[0] * x[0])).unwrap();
        approx::assert_relative_eq!(wider, 2.0, max_relative = 1e-9);
        // to one side it even falls at first: as far as is plausible, not beyond
        let wider = valley.wider(&mut |x| Ok(if x[0] > 0.0 { -1.0 } else { 1e3 })).unwrap();
        approx::assert_relative_eq!(wider, 10.0, max_relative = 1e-9);
        // where nothing can be simulated there is an end, other errors are told
        let broken = |kind| move |_: &[f64]| Err(gradreel::Error::new(kind, "no"));
        assert_eq!(valley.wider(&mut broken(ErrorKind::Physics)).unwrap(), 1.0);
        assert!(valley.wider(&mut broken(ErrorKind::Interrupted)).is_err());
    }
}
