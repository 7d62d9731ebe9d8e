//! The HTML page of a run: one self-contained file that needs no network.

use std::fmt::Write as _;

use super::base64;
use super::markup::{escape, relative_link};
use super::plot::Plot;

mod scene;

pub use scene::Scene;

const STYLE: &str = include_str!("page.css");
const VIEWER: &str = include_str!("viewer.js");
/// Animations narrower than this \[px\] are enlarged by an integer factor.
const ROOMY: usize = 720;

/// A main result.
#[derive(Debug, Clone)]
pub struct Headline {
    /// Its symbol: `E`.
    pub symbol: String,
    /// Its name: `Young's modulus`.
    pub label: String,
    /// Rounded value with a suitable unit: `301 kPa`.
    pub readable: String,
    /// Full precision in the SI unit: `3.0123e5 Pa`.
    pub exact: String,
    /// Source of the value: `fitted; started at 10 kPa`.
    pub note: String,
}

/// A drawing with its own heading.
#[derive(Debug, Clone)]
pub struct Drawing {
    /// Heading.
    pub heading: String,
    /// One SVG element, embedded as it is.
    pub svg: String,
    /// Caption, embedded as it is.
    pub caption: String,
}

impl Drawing {
    /// Width and height of a PNG \[pixels\].
    pub fn size_of(png: &[u8]) -> [usize; 2] {
        let side = |at: usize| png.get(at..at + 4).map_or(1, |b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]));
        [side(16), side(20)].map(|side| side as usize)
    }

    /// A PNG in its own size, or as wide as there is room.
    pub fn of_png(heading: String, png: &[u8], caption: &str) -> Self {
        let [width, height] = Self::size_of(png);
        let svg = format!(
            "<svg class=\"drawing\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{}\" \
             xmlns=\"http://www.w3.org/2000/svg\">\n<image width=\"{width}\" height=\"{height}\" \
             href=\"data:image/png;base64,{}\"/>\n</svg>",
            escape(&heading),
            base64::encode(png)
        );
        Self { heading, svg, caption: escape(caption) }
    }
}

/// Contents of the page. Empty parts are omitted.
#[derive(Debug, Clone)]
pub struct Page<'a> {
    /// Name of the clip or run.
    pub title: &'a str,
    /// One line beneath the title.
    pub subtitle: String,
    /// Main results, most important first.
    pub headlines: Vec<Headline>,
    /// Bytes of a GIF: input and reconstruction side by side.
    pub animation: Option<&'a [u8]>,
    /// Caption of the animation.
    pub animation_caption: String,
    /// Drawings.
    pub drawings: Vec<Drawing>,
    /// The particles, for the player.
    pub scene: Option<Scene>,
    /// Curves, such as convergence.
    pub plots: Vec<Plot>,
    /// Measured values and assumptions: name and text.
    pub notes: Vec<(String, String)>,
    /// Stages of the run with their durations \[s\].
    pub timings: Vec<(String, f64)>,
    /// The resolved configuration.
    pub config_toml: String,
    /// Other files in the folder: link relative to the page, and description.
    pub files: Vec<(String, String)>,
}

impl Page<'_> {
    /// The page as the text of one HTML file.
    ///
    /// All text is escaped, including names such as `<script>`. Pictures and data are embedded; the page's policy
    /// forbids all connections.
    ///
    /// # Panics
    /// If a scene frame has a different number of particles than there are colours.
    #[track_caller]
    pub fn html(&self) -> String {
        let title = escape(self.title);
        let mut parts = vec![headlines(&self.headlines)];
        if let Some(gif) = self.animation {
            parts.push(animation(gif, &self.animation_caption));
        }
        parts.extend(self.drawings.iter().map(drawing));
        if let Some(scene) = self.scene.as_ref() {
            parts.push(player(scene));
        }
        parts.push(plots(&self.plots));
        parts.push(notes(&self.notes));
        parts.push(timings(&self.timings));
        parts.push(files(&self.files));
        parts.push(config(&self.config_toml));
        let subtitle = paragraph("subtitle", &self.subtitle);
        let body = parts.concat();
        let isa = gradreel::isa();
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; \
             style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\n\
             <title>{title} · gradreel</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n\
             <header><h1>{title}</h1>{subtitle}</header>\n{body}</main>\n\
             <footer>Made by gradreel with {isa} instructions. This page holds all it shows and opens without a network.</footer>\n\
             </body>\n</html>\n"
        )
    }
}

fn paragraph(class: &str, content: &str) -> String {
    if content.is_empty() { String::new() } else { format!("<p class=\"{class}\">{}</p>\n", escape(content)) }
}

/// A section with a heading; nothing if the content is empty.
fn section(class: &str, heading: &str, content: &str) -> String {
    if content.is_empty() {
        return String::new();
    }
    format!("<section class=\"{class}\">\n<h2>{heading}</h2>\n{content}</section>\n")
}

fn headlines(list: &[Headline]) -> String {
    let mut cards = String::new();
    for Headline { symbol, label, readable, exact, note } in list {
        let [symbol, label, readable, exact] = [symbol, label, readable, exact].map(|t| escape(t));
        writeln!(
            cards,
            "<article class=\"number\"><h2>{label} <i>{symbol}</i></h2><p class=\"readable\">{readable}</p>\
             <p class=\"exact\">{exact}</p>{}</article>",
            paragraph("note", note)
        )
        .expect("a string accepts every write");
    }
    if cards.is_empty() { cards } else { format!("<div class=\"numbers\">\n{cards}</div>\n") }
}

/// The GIF in its true aspect ratio; small ones are enlarged by an integer factor without smoothing.
fn animation(gif: &[u8], caption: &str) -> String {
    let size = |at: usize| gif.get(at..at + 2).map_or(0, |b| usize::from(u16::from_le_bytes([b[0], b[1]])));
    let (width, height) = (size(6), size(8));
    let factor = ROOMY.checked_div(width).unwrap_or(1).max(1);
    let measures = match width > 0 && height > 0 {
        true => format!(" width=\"{}\" height=\"{}\"", width * factor, height * factor),
        false => String::new(),
    };
    let class = if factor > 1 { " class=\"enlarged\"" } else { "" };
    let alt = if caption.is_empty() { "The input beside the reconstruction" } else { caption };
    let content = format!(
        "<figure><img{class}{measures} alt=\"{}\" src=\"data:image/gif;base64,{}\">{}</figure>\n",
        escape(alt),
        base64::encode(gif),
        if caption.is_empty() { String::new() } else { format!("<figcaption>{}</figcaption>", escape(caption)) }
    );
    section("card animation", "In motion", &content)
}

fn drawing(Drawing { heading, svg, caption }: &Drawing) -> String {
    let content = format!("<figure>{svg}<figcaption>{caption}</figcaption></figure>\n");
    section("card animation", &escape(heading), &content)
}

/// The particle player. Its data are in an inert script element, with `<` escaped so that nothing can end the
/// element.
#[track_caller]
fn player(scene: &Scene) -> String {
    let data = scene.data().to_string().replace('<', "\\u003c");
    let content = format!(
        "<div id=\"player\" hidden>\n\
         <canvas id=\"view\" tabindex=\"0\" role=\"img\" \
         aria-label=\"Moving particles in three dimensions\"></canvas>\n\
         <div class=\"controls\"><button id=\"play\" type=\"button\">Pause</button>\
         <input id=\"time\" type=\"range\" min=\"0\" step=\"any\" value=\"0\" aria-label=\"Time\">\
         <output id=\"clock\"></output>\
         <label>Speed <select id=\"speed\"></select></label>\
         <label id=\"cameras-label\"><input id=\"cameras\" type=\"checkbox\"> Cameras</label>\
         <button id=\"home\" type=\"button\">Reset view</button></div>\n\
         <p class=\"note\" id=\"legend\"></p>\n</div>\n\
         <p id=\"no-player\" class=\"fallback\">\
         The moving particles cannot be shown here: the player needs JavaScript and WebGL.</p>\n\
         <script type=\"application/json\" id=\"scene\">{data}</script>\n<script>\n{VIEWER}</script>\n"
    );
    section("card player", "Particles", &content)
}

fn plots(list: &[Plot]) -> String {
    let figures: String =
        list.iter().map(|plot| format!("<figure class=\"card\">\n{}</figure>\n", plot.svg())).collect();
    let content = if figures.is_empty() { figures } else { format!("<div class=\"plots\">\n{figures}</div>\n") };
    section("convergence", "Curves", &content)
}

fn notes(list: &[(String, String)]) -> String {
    let row =
        |(name, text): &(String, String)| format!("<tr><th>{}</th><td>{}</td></tr>\n", escape(name), escape(text));
    let rows: String = list.iter().map(row).collect();
    let content = if rows.is_empty() { rows } else { format!("<table class=\"notes\">\n{rows}</table>\n") };
    section("card", "Measured and assumed", &content)
}

/// Stages with bars proportional to their durations.
fn timings(list: &[(String, f64)]) -> String {
    let longest = list.iter().map(|t| t.1).filter(|s| s.is_finite()).fold(0.0, f64::max);
    let mut rows = String::new();
    for (stage, seconds) in list {
        let share = if longest > 0.0 && seconds.is_finite() { (100.0 * seconds / longest).max(0.0) } else { 0.0 };
        writeln!(
            rows,
            "<tr><th>{}</th><td class=\"bar\"><span style=\"width:{share:.1}%\"></span></td><td>{}</td></tr>",
            escape(stage),
            duration(*seconds)
        )
        .expect("a string accepts every write");
    }
    if list.len() > 1 {
        let total: f64 = list.iter().map(|t| t.1).sum();
        writeln!(rows, "<tr class=\"total\"><th>together</th><td></td><td>{}</td></tr>", duration(total))
            .expect("a string accepts every write");
    }
    let content = if rows.is_empty() { rows } else { format!("<table class=\"timings\">\n{rows}</table>\n") };
    section("card", "Time taken", &content)
}

/// `0.42 s`, `12.3 s`, `4 min 05 s`, `2 h 07 min`.
fn duration(seconds: f64) -> String {
    match seconds {
        s if !s.is_finite() || s < 0.0 => "unknown".to_string(),
        s if s < 9.995 => format!("{s:.2} s"),
        s if s < 59.95 => format!("{s:.1} s"),
        s if s < 3599.5 => format!("{} min {:02} s", s.round() as u64 / 60, s.round() as u64 % 60),
        s => format!("{} h {:02} min", (s / 60.0).round() as u64 / 60, (s / 60.0).round() as u64 % 60),
    }
}

fn files(list: &[(String, String)]) -> String {
    let row = |(path, what): &(String, String)| {
        let (link, name, what) = (relative_link(path), escape(path), escape(what));
        format!("<tr><th><a href=\"{link}\">{name}</a></th><td>{what}</td></tr>\n")
    };
    let rows: String = list.iter().map(row).collect();
    let content = if rows.is_empty() { rows } else { format!("<table class=\"files\">\n{rows}</table>\n") };
    section("card", "Files", &content)
}

fn config(toml: &str) -> String {
    if toml.is_empty() {
        return String::new();
    }
    let toml = escape(toml);
    format!("<details class=\"card\"><summary>Configuration</summary>\n<pre><code>{toml}</code></pre></details>\n")
}
