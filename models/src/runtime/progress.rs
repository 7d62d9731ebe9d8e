//! Progress of a long run: bars on a terminal, periodic lines in a log file.

use std::borrow::Cow;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressFinish, ProgressStyle};

use super::terminal::tell;

/// Minimum time between two log lines of a stage, and before its first.
const BETWEEN_LINES: Duration = Duration::from_secs(5);
const FIRST_LINE: Duration = Duration::from_secs(1);

/// Refresh interval of a bar's clock.
const TICK: Duration = Duration::from_millis(500);

/// Progress display of a run's stages.
///
/// On a terminal each stage is a bar with its remaining time. If stderr is a file or a pipe, each stage is a plain
/// line after a second, one at most every five seconds from then on, and one at its end.
///
/// ```
/// use gradreel_models::runtime::progress::Progress;
///
/// let progress = Progress::new(true);
/// let stage = progress.stage("fitting the field", 200);
/// for step in 1..=200 {
///     stage.set(step, "loss 0.01");
/// }
/// stage.finish("31.2 dB");
/// ```
#[derive(Debug)]
pub struct Progress(Kind);

#[derive(Debug)]
enum Kind {
    Quiet,
    Bars(MultiProgress),
    Lines,
}

/// One stage of a run. If dropped without [`Stage::finish`], for example on an error, its last state remains
/// visible.
#[derive(Debug)]
pub struct Stage(Sink);

#[derive(Debug)]
enum Sink {
    Quiet,
    Bar(ProgressBar),
    Lines(Mutex<Lines>),
}

impl Progress {
    /// Shows progress on stderr, or nothing if `quiet`.
    pub fn new(quiet: bool) -> Self {
        if quiet {
            return Self(Kind::Quiet);
        }
        let bars = MultiProgress::with_draw_target(ProgressDrawTarget::stderr());
        Self(if bars.is_hidden() { Kind::Lines } else { Kind::Bars(bars) })
    }

    /// Starts a stage of `total` steps; 0 if unknown.
    pub fn stage(&self, title: &str, total: u64) -> Stage {
        Stage(match &self.0 {
            Kind::Quiet => Sink::Quiet,
            Kind::Bars(bars) => Sink::Bar(bars.add(bar(title, total))),
            Kind::Lines => Sink::Lines(Mutex::new(Lines::new(title, total, Instant::now()))),
        })
    }
}

impl Stage {
    /// Reports `done` steps, and a short message such as the loss.
    pub fn set(&self, done: u64, message: &str) {
        match &self.0 {
            Sink::Quiet => {}
            Sink::Bar(bar) => {
                bar.set_position(done);
                bar.set_message(message.to_string());
            }
            Sink::Lines(lines) => {
                if let Some(line) = locked(lines).set(Instant::now(), done, message) {
                    tell(format_args!("{line}"));
                }
            }
        }
    }

    /// Ends the stage with a result.
    pub fn finish(self, message: &str) {
        match &self.0 {
            Sink::Quiet => {}
            Sink::Bar(bar) => bar.finish_with_message(message.to_string()),
            Sink::Lines(lines) => tell(format_args!("{}", locked(lines).end(Instant::now(), message))),
        }
    }
}

/// A poisoned lock is harmless: these values cannot be left in a harmful state.
fn locked(lines: &Mutex<Lines>) -> MutexGuard<'_, Lines> {
    lines.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn bar(title: &str, total: u64) -> ProgressBar {
    let (length, template) = match total {
        0 => (None, "{prefix:<24} {spinner} {pos} in {elapsed}  {wide_msg}"),
        _ => (Some(total), "{prefix:<24} {bar:24} {percent:>3} % {elapsed} +{eta}  {wide_msg}"),
    };
    let style = ProgressStyle::with_template(template).expect("the template is fixed");
    let bar = ProgressBar::with_draw_target(length, ProgressDrawTarget::hidden())
        .with_style(style)
        .with_prefix(Cow::Owned(title.to_string()))
        .with_finish(ProgressFinish::Abandon);
    bar.enable_steady_tick(TICK);
    bar
}

/// Log lines of one stage.
#[derive(Debug)]
struct Lines {
    title: String,
    total: u64,
    begun: Instant,
    /// Time of the last line.
    last: Option<Instant>,
}

impl Lines {
    fn new(title: &str, total: u64, now: Instant) -> Self {
        Self { title: title.into(), total, begun: now, last: None }
    }

    /// The line for `done` steps, if one is due.
    fn set(&mut self, now: Instant, done: u64, message: &str) -> Option<String> {
        let elapsed = now.duration_since(self.begun);
        let due = match self.last {
            None => elapsed >= FIRST_LINE,
            Some(last) => now.duration_since(last) >= BETWEEN_LINES,
        };
        if !due {
            return None;
        }
        self.last = Some(now);
        let Self { title, total, .. } = self;
        let left = elapsed.as_secs_f64() * total.saturating_sub(done) as f64 / done as f64;
        // no estimate without progress, or if it exceeds the clock's range
        let left = Duration::try_from_secs_f64(left).map(|left| format!(", about {} left", clock(left)));
        let line = match (u128::from(done.min(*total)) * 100).checked_div(u128::from(*total)) {
            None => format!("{title}: {done} steps, {}", clock(elapsed)),
            Some(percent) => format!("{title}: {percent} %, {}{}", clock(elapsed), left.unwrap_or_default()),
        };
        Some(with_message(line, message))
    }

    fn end(&self, now: Instant, message: &str) -> String {
        with_message(format!("{}: done in {}", self.title, clock(now.duration_since(self.begun))), message)
    }
}

fn with_message(line: String, message: &str) -> String {
    if message.is_empty() { line } else { format!("{line}: {message}") }
}

/// `42 s`, `3 min 07 s` or `2 h 05 min`.
fn clock(time: Duration) -> String {
    match time.as_secs() {
        s @ ..60 => format!("{s} s"),
        s @ 60..3600 => format!("{} min {:02} s", s / 60, s % 60),
        s => format!("{} h {:02} min", s / 3600, s % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_file_gets_a_line_after_a_second_and_every_five_from_then_on() {
        let begun = Instant::now();
        let at = |seconds: f64| begun + Duration::from_secs_f64(seconds);
        let mut lines = Lines::new("fit", 400, begun);
        assert_eq!(lines.set(at(0.0), 0, ""), None);
        assert_eq!(lines.set(at(0.9), 8, "loss 3"), None);
        assert_eq!(lines.set(at(1.0), 10, "loss 2").unwrap(), "fit: 2 %, 1 s, about 39 s left: loss 2");
        assert_eq!(lines.set(at(5.9), 90, "loss 2"), None);
        let line = lines.set(at(10.0), 100, "loss 1").unwrap();
        assert_eq!(line, "fit: 25 %, 10 s, about 30 s left: loss 1");
        assert_eq!(lines.set(at(14.9), 150, ""), None, "five seconds count from the last line");
        assert_eq!(lines.set(at(100.0), 400, "").unwrap(), "fit: 100 %, 1 min 40 s, about 0 s left");
        assert_eq!(lines.end(at(7500.0), "ok"), "fit: done in 2 h 05 min: ok");
    }

    #[test]
    fn unknown_lengths_and_slow_first_steps_have_no_estimate() {
        let begun = Instant::now();
        let mut open = Lines::new("read", 0, begun);
        assert_eq!(open.set(begun + Duration::from_secs(6), 3, "").unwrap(), "read: 3 steps, 6 s");
        let mut slow = Lines::new("fit", 10, begun);
        assert_eq!(slow.set(begun + Duration::from_secs(187), 0, "").unwrap(), "fit: 0 %, 3 min 07 s");
        let mut over = Lines::new("fit", 10, begun);
        assert_eq!(over.set(begun + Duration::from_secs(6), 12, "").unwrap(), "fit: 100 %, 6 s, about 0 s left");
    }
}
