//! Where truths lie in their posteriors: flat histograms are those of posteriors that are right.

use std::collections::BTreeMap;

use super::Line;

const BINS: usize = 10;
/// Size of one histogram \[pixels\].
const SIZE: [f64; 2] = [170.0, 90.0];
/// Histograms in a row.
const ACROSS: usize = 4;

/// Rank histograms of all unknowns of all families as an SVG picture, with the band of two binomial deviations around flat.
///
/// Source: Talts et al., *Validating Bayesian inference algorithms with simulation-based calibration*, 2018.
pub fn ranks(lines: &[Line]) -> String {
    let mut all: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for line in lines {
        for (name, score) in &line.scores {
            let kind = if name.starts_with("velocity_") { "velocity" } else { name };
            all.entry(format!("{} {kind}", line.family)).or_default().push(score.rank);
        }
    }
    let rows = all.len().div_ceil(ACROSS).max(1);
    let [width, height] = SIZE;
    let [pitch_x, pitch_y] = [width + 30.0, height + 40.0];
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{}\" height=\"{}\" font-family=\"sans-serif\" font-size=\"11\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        ACROSS as f64 * pitch_x + 30.0,
        rows as f64 * pitch_y + 20.0
    );
    for (place, (title, ranks)) in all.iter().enumerate() {
        let (x, y) = (30.0 + (place % ACROSS) as f64 * pitch_x, 30.0 + (place / ACROSS) as f64 * pitch_y);
        let mut counts = [0usize; BINS];
        ranks.iter().for_each(|rank| counts[((rank * BINS as f64) as usize).min(BINS - 1)] += 1);
        let flat = ranks.len() as f64 / BINS as f64;
        let spread = 2.0 * (flat * (1.0 - 1.0 / BINS as f64)).sqrt();
        let most = counts.iter().fold(flat + spread, |most, count| most.max(*count as f64));
        let up = |count: f64| y + height * (1.0 - count.max(0.0) / most);
        svg += &format!("<text x=\"{x}\" y=\"{:.1}\">{title} ({})</text>\n", y - 6.0, ranks.len());
        svg += &format!(
            "<rect x=\"{x}\" y=\"{:.1}\" width=\"{width}\" height=\"{:.1}\" fill=\"#dde6f2\"/>\n",
            up(flat + spread),
            up(flat - spread) - up(flat + spread)
        );
        for (bin, count) in counts.iter().enumerate() {
            let bar = width / BINS as f64;
            svg += &format!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#3b6ea5\" fill-opacity=\"0.7\"/>\n",
                x + bin as f64 * bar + 1.0,
                up(*count as f64),
                bar - 2.0,
                y + height - up(*count as f64)
            );
        }
        svg += &format!(
            "<line x1=\"{x}\" y1=\"{0:.1}\" x2=\"{1:.1}\" y2=\"{0:.1}\" stroke=\"#666\"/>\n",
            y + height,
            x + width
        );
    }
    svg + "</svg>\n"
}
