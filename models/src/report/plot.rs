//! Line plots as SVG: curves over iterations or time, on a linear or logarithmic axis.

use std::fmt::Write as _;

use super::markup::escape;

mod axis;

use axis::Axis;

const WIDTH: f64 = 520.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const FIELD: f64 = 210.0;
const BELOW: f64 = 50.0;
/// Width of a legend character at 12 px.
const CHARACTER: f64 = 6.7;
/// Maximum number of points that a series marks with dots.
const DOTTED: usize = 40;
/// Colours with sufficient contrast on white and on near-black; a page may restyle the classes `series-0` …
/// `series-5`.
const COLOURS: [&str; 6] = ["#3b7dd8", "#d9733a", "#2f9e77", "#a565c9", "#c79a1e", "#d0527a"];

/// One curve.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend.
    pub label: String,
    /// Points `(x, y)` in drawing order, in the units of the axes.
    pub points: Vec<(f64, f64)>,
}

/// A plot of one or more curves.
#[derive(Debug, Clone)]
pub struct Plot {
    /// Title.
    pub title: String,
    /// Label of the horizontal axis, with its SI unit.
    pub x_label: String,
    /// Label of the vertical axis, with its SI unit.
    pub y_label: String,
    /// Whether the vertical axis is logarithmic.
    pub log_y: bool,
    /// The curves.
    pub series: Vec<Series>,
    /// A horizontal dashed line, such as a true value: its label and height.
    pub reference: Option<(String, f64)>,
}

impl Plot {
    /// The plot as one SVG element, 520 units wide, for use in a page or as a file.
    ///
    /// Text and lines inherit the surrounding text colour. A point that is not finite (or not positive on a
    /// logarithmic axis) interrupts its curve and is counted in a line below the plot.
    pub fn svg(&self) -> String {
        let mut body = String::new();
        let hidden = self.series.iter().flat_map(|s| &s.points).filter(|&&p| !self.shows(p)).count();
        let top = self.legend(&mut body);
        let height = top + FIELD + BELOW + if hidden > 0 { 18.0 } else { 0.0 };
        match self.axes() {
            Some((x, y)) => {
                frame(&mut body, &x, &y, top);
                self.draw_reference(&mut body, &y, top);
                for (index, series) in self.series.iter().enumerate() {
                    self.draw(&mut body, series, index, &x, &y, top);
                }
            }
            None => {
                let (cx, cy) = ((LEFT + WIDTH - RIGHT) / 2.0, top + FIELD / 2.0);
                rectangle(&mut body, top);
                text(&mut body, cx, cy, "middle", 0.65, "no points to show");
            }
        }
        text(&mut body, (LEFT + WIDTH - RIGHT) / 2.0, top + FIELD + 42.0, "middle", 0.75, &self.x_label);
        if hidden > 0 {
            let points = if hidden == 1 { "1 point is".to_string() } else { format!("{hidden} points are") };
            let why = if self.log_y { "not finite or not positive" } else { "not finite" };
            text(&mut body, LEFT, height - 6.0, "start", 0.75, &format!("{points} not shown: {why}"));
        }
        let title = escape(&self.title);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" \
             aria-label=\"{title}\" font-family=\"system-ui, sans-serif\" font-size=\"12\" fill=\"none\">\n\
             <text x=\"12\" y=\"24\" font-size=\"16\" font-weight=\"600\" fill=\"currentColor\">{title}</text>\n\
             {body}</svg>\n"
        )
    }

    fn shows(&self, (x, y): (f64, f64)) -> bool {
        Axis::shows(false, x) && Axis::shows(self.log_y, y)
    }

    /// Both axes, fitted to the valid points; `None` without valid points.
    fn axes(&self) -> Option<(Axis, Axis)> {
        let shown = || self.series.iter().flat_map(|s| s.points.iter().copied()).filter(|&p| self.shows(p));
        let level = self.reference.iter().map(|r| r.1).filter(|&y| Axis::shows(self.log_y, y));
        let x = Axis::around(shown().map(|p| p.0), false, 0.0)?;
        let y = Axis::around(shown().map(|p| p.1).chain(level), self.log_y, 0.06)?;
        Some((x, y))
    }

    /// Writes the label of the vertical axis and the legend; returns the top of the plot area.
    fn legend(&self, body: &mut String) -> f64 {
        let mut at = (12.0, 66.0);
        text(body, at.0, 46.0, "start", 0.75, &self.y_label);
        let curves = self.series.iter().enumerate().map(|(index, series)| (Some(index), series.label.as_str()));
        let lines = self.reference.iter().map(|(label, _)| (None, label.as_str()));
        let entries: Vec<_> = curves.chain(lines).collect();
        if entries.len() < 2 {
            return 62.0;
        }
        for (index, label) in entries {
            let room = 28.0 + CHARACTER * label.chars().count() as f64 + 18.0;
            if at.0 > 12.0 && at.0 + room > WIDTH - RIGHT {
                at = (12.0, at.1 + 18.0);
            }
            let (x, y) = at;
            let stroke = match index {
                Some(i) => format!("class=\"series-{c}\" stroke=\"{}\" stroke-width=\"3\"", COLOURS[i % 6], c = i % 6),
                None => "stroke=\"currentColor\" stroke-dasharray=\"5 4\" stroke-width=\"1.5\"".to_string(),
            };
            put(body, &format!("<path d=\"M{x:.1} {:.1}h20\" stroke-linecap=\"round\" {stroke}/>", y - 4.0));
            text(body, x + 28.0, y, "start", 0.9, label);
            at.0 += room;
        }
        at.1 + 16.0
    }

    fn draw_reference(&self, body: &mut String, y: &Axis, top: f64) {
        let Some((_, level)) = self.reference.as_ref().filter(|r| Axis::shows(self.log_y, r.1)) else { return };
        let line = format!(
            "<path class=\"reference\" d=\"M{LEFT} {:.2}H{}\" stroke=\"currentColor\" stroke-opacity=\"0.7\" \
             stroke-width=\"1.5\" stroke-dasharray=\"5 4\"/>",
            top + FIELD * (1.0 - y.place(*level)),
            WIDTH - RIGHT
        );
        put(body, &line);
    }

    /// Draws a curve as one path with gaps at invalid points, and with dots if there are few points.
    fn draw(&self, body: &mut String, series: &Series, index: usize, x: &Axis, y: &Axis, top: f64) {
        let (mut path, mut dots) = (String::new(), String::new());
        let shown = |i: usize| series.points.get(i).is_some_and(|&p| self.shows(p));
        for (i, &point) in series.points.iter().enumerate().filter(|&(_, &p)| self.shows(p)) {
            let px = LEFT + (WIDTH - LEFT - RIGHT) * x.place(point.0);
            let py = top + FIELD * (1.0 - y.place(point.1));
            let joined = i > 0 && shown(i - 1);
            write!(path, "{}{px:.2} {py:.2}", if joined { 'L' } else { 'M' }).expect("a string accepts every write");
            if series.points.len() <= DOTTED || !joined && !shown(i + 1) {
                write!(dots, "M{px:.2} {py:.2}h0").expect("a string accepts every write");
            }
        }
        let class = index % COLOURS.len();
        let colour = COLOURS[class];
        let style = "stroke-linejoin=\"round\" stroke-linecap=\"round\"";
        for (d, thickness) in [(path, 2.0), (dots, 5.5)].iter().filter(|(d, _)| !d.is_empty()) {
            let stroke = format!("stroke=\"{colour}\" stroke-width=\"{thickness}\" {style}");
            put(body, &format!("<path class=\"series-{class}\" d=\"{d}\" {stroke}/>"));
        }
    }
}

/// The plot area with grid lines and tick labels.
fn frame(body: &mut String, x: &Axis, y: &Axis, top: f64) {
    let bottom = top + FIELD;
    rectangle(body, top);
    for (value, label) in y.ticks(5) {
        let py = top + FIELD * (1.0 - y.place(value));
        grid_line(body, &format!("M{LEFT} {py:.2}H{}", WIDTH - RIGHT));
        text(body, LEFT - 8.0, py + 4.0, "end", 0.75, &label);
    }
    for (value, label) in x.ticks(6) {
        let px = LEFT + (WIDTH - LEFT - RIGHT) * x.place(value);
        grid_line(body, &format!("M{px:.2} {top}V{bottom}"));
        text(body, px, bottom + 20.0, "middle", 0.75, &label);
    }
}

fn rectangle(body: &mut String, top: f64) {
    let width = WIDTH - LEFT - RIGHT;
    put(
        body,
        &format!(
            "<rect x=\"{LEFT}\" y=\"{top}\" width=\"{width}\" height=\"{FIELD}\" stroke=\"currentColor\" \
             stroke-opacity=\"0.25\"/>"
        ),
    );
}

fn grid_line(body: &mut String, d: &str) {
    put(body, &format!("<path d=\"{d}\" stroke=\"currentColor\" stroke-opacity=\"0.1\"/>"));
}

fn text(body: &mut String, x: f64, y: f64, anchor: &str, opacity: f64, content: &str) {
    let content = escape(content);
    put(
        body,
        &format!(
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" fill=\"currentColor\" \
             fill-opacity=\"{opacity}\">{content}</text>"
        ),
    );
}

fn put(body: &mut String, element: &str) {
    body.push_str(element);
    body.push('\n');
}
