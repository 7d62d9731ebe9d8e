//! Change of each pixel against the plate, discounting shadows.

/// Added to linear light before taking ratios, so that noise does not dominate dark pixels (share of full scale).
pub(super) const FLOOR: f32 = 0.04;
/// A shadow leaves at least this share of the plate's light …
const DARKEST_SHADOW: f32 = 0.12;
/// … and light reflected by the object adds at most this share.
const BRIGHTEST_REFLECTION: f32 = 1.08;

/// Log ratios of the three channels minus their mean, in an orthonormal basis of that plane: red against green, and
/// both against blue.
pub(super) type Hue = [f32; 2];

/// The hue of shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Tint {
    /// Its direction, of length 1.
    pub axis: Hue,
    /// Minimum and maximum of the hue along the axis, as shares of the loss of brightness.
    pub shares: [f32; 2],
}

/// The log ratio of image and plate, `ln((I + ε)/(P + ε))` in linear light, split into brightness and hue.
///
/// A shadow multiplies all channels by nearly the same factor: it changes the brightness, and the hue in one
/// direction only.
pub(super) struct Change {
    /// Mean of the three log ratios.
    pub brightness: Vec<f32>,
    /// The log ratios minus their mean.
    pub hue: Vec<Hue>,
    /// Evidence for the object (see [`evidence`]).
    pub evidence: Vec<f32>,
    /// Standard deviation of the hue of unchanged pixels, per dimension.
    pub noise: f32,
}

impl Change {
    pub fn between(seen: &[[f32; 3]], empty: &[[f32; 3]], tint: Option<Tint>) -> Change {
        let mut change = Change {
            brightness: Vec::with_capacity(seen.len()),
            hue: Vec::with_capacity(seen.len()),
            evidence: Vec::with_capacity(seen.len()),
            noise: 0.0,
        };
        for (i, p) in seen.iter().zip(empty) {
            let [r, g, b] = [0, 1, 2].map(|c| ((i[c] + FLOOR) / (p[c] + FLOOR)).ln());
            let brightness = (r + g + b) / 3.0;
            let hue = [(r - g) / 2.0f32.sqrt(), (r + g - 2.0 * b) / 6.0f32.sqrt()];
            change.brightness.push(brightness);
            change.hue.push(hue);
            change.evidence.push(evidence(brightness, hue, tint));
        }
        change.noise = noise(&change.hue);
        change
    }
}

/// Evidence for the object, `sqrt(h² + 3 e²)`. `e` is the excess of the brightness beyond the range of shadows; `h`
/// is the hue. If the hue of shadows is known, only two parts of the hue count: the component perpendicular to its
/// axis, and the component along it beyond that of a shadow of this brightness.
pub(super) fn evidence(brightness: f32, [x, y]: Hue, tint: Option<Tint>) -> f32 {
    let (low, high) = (DARKEST_SHADOW.ln(), BRIGHTEST_REFLECTION.ln());
    let excess = (brightness - high).max(0.0) + (low - brightness).max(0.0);
    let [along, across] = match tint {
        Some(Tint { axis: [a, b], shares }) => {
            let [least, most] = shares.map(|share| share * (-brightness).max(0.0));
            let along = a * x + b * y;
            [(along - most).max(0.0) + (least - along).max(0.0), a * y - b * x]
        }
        None => [x, y],
    };
    (along * along + across * across + 3.0 * excess * excess).sqrt()
}

/// Estimated from differences of neighbouring pixels, few of which cross an edge. Pixels exactly equal to the plate
/// (a rendered sky) are ignored.
fn noise(hue: &[Hue]) -> f32 {
    let changed = |h: &Hue| *h != [0.0; 2];
    let step = |pair: &[Hue]| (pair[0][0] - pair[1][0]).hypot(pair[0][1] - pair[1][1]);
    let mut steps: Vec<f32> = hue.windows(2).filter(|pair| pair.iter().all(changed)).map(step).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    // In two dimensions the median length of a difference of two samples is 1.18 √2 σ.
    *steps.select_nth_unstable_by(middle, f32::total_cmp).1 / 1.67
}
