//! One axis of a plot: range, ticks and tick labels.

/// Maximum number of decades of a logarithmic axis that are all labelled.
const MOST_DECADES: i32 = 7;

/// Range `[low, high]` of an axis and whether it is logarithmic (base 10).
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    low: f64,
    high: f64,
    log: bool,
}

impl Axis {
    /// The axis for finite values (positive ones if `log`); `None` if there are none.
    pub fn around(values: impl Iterator<Item = f64>, log: bool, margin: f64) -> Option<Self> {
        let scaled = values.map(|v| if log { v.log10() } else { v });
        let (low, high) = scaled.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            return None;
        }
        let span = high / 2.0 - low / 2.0;
        let pad = match span > 0.0 {
            true => 2.0 * span * margin,
            false if log => 0.3,
            false => (high.abs() * 0.1).max(f64::MIN_POSITIVE.sqrt()),
        };
        let pad = if span > 0.0 || low != 0.0 || log { pad } else { 1.0 };
        Some(Self { low: (low - pad).max(f64::MIN), high: (high + pad).min(f64::MAX), log })
    }

    /// Whether the axis can show the value.
    pub fn shows(log: bool, value: f64) -> bool {
        value.is_finite() && (!log || value > 0.0)
    }

    /// Relative position of a value on the axis: 0 at the low end, 1 at the high end.
    pub fn place(&self, value: f64) -> f64 {
        let v = if self.log { value.log10() } else { value };
        (v / 2.0 - self.low / 2.0) / (self.high / 2.0 - self.low / 2.0)
    }

    /// Ticks inside the range: value and label, about `wanted` of them.
    pub fn ticks(&self, wanted: usize) -> Vec<(f64, String)> {
        if self.log { self.log_ticks(wanted) } else { linear_ticks(self.low, self.high, wanted) }
    }

    /// Decades; with fewer than three of them also 2 and 5 times each; if these are too few, evenly spaced values.
    fn log_ticks(&self, wanted: usize) -> Vec<(f64, String)> {
        let (first, last) = (self.low.ceil() as i32, self.high.floor() as i32);
        let value = |mantissa: f64, k: i32| mantissa * 10f64.powf(f64::from(k));
        // powers of ten below the smallest positive number round to zero
        let shown = |v: f64| Self::shows(true, v) && (self.low..=self.high).contains(&v.log10());
        let decades = last - first + 1;
        if decades >= 3 {
            let stride = (decades + MOST_DECADES - 1) / MOST_DECADES;
            let kept = (first..=last).filter(|k| k.rem_euclid(stride) == 0).map(|k| (1.0, k));
            return labelled(kept.filter(|&(m, k)| shown(value(m, k))).collect());
        }
        let steps: Vec<(f64, i32)> = (first - 1..=last + 1)
            .flat_map(|k| [1.0, 2.0, 5.0].map(|m| (m, k)))
            .filter(|&(m, k)| shown(value(m, k)))
            .collect();
        if steps.len() >= 3 {
            return labelled(steps);
        }
        linear_ticks(10f64.powf(self.low), 10f64.powf(self.high), wanted)
    }
}

/// Multiples of 1, 2 or 5 times a power of ten.
fn linear_ticks(low: f64, high: f64, wanted: usize) -> Vec<(f64, String)> {
    let rough = (high / wanted as f64 - low / wanted as f64).max(f64::MIN_POSITIVE);
    let decade = 10f64.powf(rough.log10().floor());
    let step = decade * [1.0, 2.0, 5.0].into_iter().find(|m| rough / decade <= 1.45 * m).unwrap_or(10.0);
    let (first, last) = ((low / step).ceil(), (high / step).floor());
    // beyond 2⁵³ steps neighbouring ticks are not distinct; the smallest numbers have too few digits
    if !(1e-290..=f64::MAX).contains(&step) || first.abs().max(last.abs()) > 2f64.powi(53) {
        return Vec::new();
    }
    let largest = low.abs().max(high.abs());
    let count = (last - first) as usize;
    (0..=count).map(|i| (first + i as f64) * step).map(|v| (v, tick_label(v, step, largest))).collect()
}

/// A tick label; all labels of an axis share their number of decimals and their power of ten.
fn tick_label(value: f64, step: f64, largest: f64) -> String {
    if value == 0.0 {
        return "0".to_string();
    }
    if (1e-3..1e5).contains(&largest) {
        return fixed(value, step);
    }
    let exponent = largest.log10().floor() as i32;
    let power = 10f64.powi(exponent);
    format!("{}×{}", fixed(value / power, step / power), power_of_ten(exponent))
}

/// The value with the decimals required by the step, and a true minus sign.
fn fixed(value: f64, step: f64) -> String {
    let decimals = (-(step * 1.0001).log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}").replace('-', "−")
}

/// Ticks at `m × 10ᵏ`: in plain notation if all are between 0.001 and 50 000, otherwise all with powers of ten.
fn labelled(ticks: Vec<(f64, i32)>) -> Vec<(f64, String)> {
    let plain = ticks.iter().all(|(_, k)| (-3..=4).contains(k));
    let label = |m: f64, k: i32| match plain {
        true => fixed(m * 10f64.powi(k), 10f64.powi(k)),
        false if m == 1.0 => power_of_ten(k),
        false => format!("{m}×{}", power_of_ten(k)),
    };
    ticks.into_iter().map(|(m, k)| (m * 10f64.powf(f64::from(k)), label(m, k))).collect()
}

/// `10⁻³`.
fn power_of_ten(exponent: i32) -> String {
    let raised = exponent
        .to_string()
        .chars()
        .map(|c| match c.to_digit(10) {
            Some(d) => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][d as usize],
            None => '⁻',
        })
        .collect::<String>();
    format!("10{raised}")
}
