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
/// line after a second, one at most every five seconds from then on, and one at its end. Stages of a plan
/// ([`Progress::plan`]) are numbered, and say how much time is left in all.
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
pub struct Progress {
    kind: Kind,
    plan: Mutex<Plan>,
}

#[derive(Debug)]
enum Kind {
    Quiet,
    Bars(MultiProgress),
    Lines,
}

/// One stage of a run. If dropped without [`Stage::finish`], for example on an error, its last state remains
/// visible.
#[derive(Debug)]
pub struct Stage {
    sink: Sink,
    overall: Option<Overall>,
}

#[derive(Debug)]
enum Sink {
    Quiet,
    Bar(ProgressBar),
    Lines(Mutex<Lines>),
}

impl Progress {
    /// Shows progress on stderr, or nothing if `quiet`.
    pub fn new(quiet: bool) -> Self {
        let kind = match quiet {
            true => Kind::Quiet,
            false => {
                let bars = MultiProgress::with_draw_target(ProgressDrawTarget::stderr());
                if bars.is_hidden() { Kind::Lines } else { Kind::Bars(bars) }
            }
        };
        Self { kind, plan: Mutex::default() }
    }

    /// Announces the stages that are to come, in their order, each with its title and about the share of the time that it
    /// takes, in parts of any size.
    pub fn plan(&self, stages: impl IntoIterator<Item = (String, f64)>) {
        *locked(&self.plan) = Plan { stages: stages.into_iter().collect(), begun: None };
    }

    /// Starts a stage of `total` steps; 0 if unknown.
    pub fn stage(&self, title: &str, total: u64) -> Stage {
        self.stage_from(title, total, 0)
    }

    /// Goes on with a stage of which so many steps were done before: they say nothing of its speed.
    pub fn stage_from(&self, title: &str, total: u64, from: u64) -> Stage {
        let now = Instant::now();
        let overall = locked(&self.plan).begin(title, [from, total], now);
        let numbered =
            overall.as_ref().map_or(title.to_owned(), |o| format!("stage {} of {}: {title}", o.number, o.count));
        let sink = match &self.kind {
            Kind::Quiet => Sink::Quiet,
            Kind::Bars(bars) => Sink::Bar(bars.add(bar(&numbered, total))),
            Kind::Lines => Sink::Lines(Mutex::new(Lines::new(&numbered, [from, total], now))),
        };
        Stage { sink, overall }
    }
}

impl Stage {
    /// Reports `done` steps, and a short message such as the loss.
    pub fn set(&self, done: u64, message: &str) {
        let left = || self.overall.as_ref().and_then(|overall| overall.left(Instant::now(), done));
        match &self.sink {
            Sink::Quiet => {}
            Sink::Bar(bar) => {
                bar.set_position(done);
                let left = left().map(|left| format!("{} left in all", clock(left)));
                let said = [left.as_deref().unwrap_or(""), message];
                bar.set_message(said.into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join("  "));
            }
            Sink::Lines(lines) => {
                if let Some(line) = locked(lines).set(Instant::now(), done, left(), message) {
                    tell(format_args!("{line}"));
                }
            }
        }
    }

    /// Ends the stage with a result.
    pub fn finish(self, message: &str) {
        match &self.sink {
            Sink::Quiet => {}
            Sink::Bar(bar) => bar.finish_with_message(message.to_string()),
            Sink::Lines(lines) => tell(format_args!("{}", locked(lines).end(Instant::now(), message))),
        }
    }
}

/// A poisoned lock is harmless: these values cannot be left in a harmful state.
fn locked<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn bar(title: &str, total: u64) -> ProgressBar {
    let (length, template) = match total {
        0 => (None, "{prefix:<24} {spinner} {pos} in {elapsed}  {wide_msg}"),
        _ => (Some(total), "{prefix:<24} {bar:16} {percent:>3} % {elapsed} +{eta}  {wide_msg}"),
    };
    let style = ProgressStyle::with_template(template).expect("the template is fixed");
    let bar = ProgressBar::with_draw_target(length, ProgressDrawTarget::hidden())
        .with_style(style)
        .with_prefix(Cow::Owned(title.to_string()))
        .with_finish(ProgressFinish::Abandon);
    bar.enable_steady_tick(TICK);
    bar
}

/// Stages that are to come.
#[derive(Debug, Default)]
struct Plan {
    /// Their titles, and their shares of the time.
    stages: Vec<(String, f64)>,
    /// When the first of them began here, and the share of those before it: a run that goes on has none of their time.
    begun: Option<(Instant, f64)>,
}

impl Plan {
    /// Where the stage stands in the plan, if it is in it.
    fn begin(&mut self, title: &str, [from, total]: [u64; 2], now: Instant) -> Option<Overall> {
        let place = self.stages.iter().position(|(planned, _)| planned == title)?;
        let before: f64 = self.stages[..place].iter().map(|(_, share)| share).sum();
        let whole = self.stages.iter().map(|(_, share)| share).sum();
        let (number, count, share) = (place + 1, self.stages.len(), self.stages[place].1);
        let done = share * from.min(total) as f64 / total.max(1) as f64;
        let (begun, at_begin) = *self.begun.get_or_insert((now, before + done));
        Some(Overall { number, count, before, share, whole, begun, at_begin, total })
    }
}

/// A stage's place in a plan.
#[derive(Debug, Clone, PartialEq)]
struct Overall {
    number: usize,
    count: usize,
    /// Shares of the stages before it, its own, and of all.
    before: f64,
    share: f64,
    whole: f64,
    /// When the first stage here began, and the share of those before that.
    begun: Instant,
    at_begin: f64,
    total: u64,
}

impl Overall {
    /// The time that is left in all, if the rest goes as what went so far; nothing before that is a hundredth of all.
    fn left(&self, now: Instant, done: u64) -> Option<Duration> {
        let within = done.min(self.total) as f64 / self.total.max(1) as f64;
        let reached = self.before + self.share * within;
        let gone = reached - self.at_begin;
        let elapsed = now.duration_since(self.begun).as_secs_f64();
        let left = elapsed * (self.whole - reached) / gone;
        (gone >= 0.01 * self.whole).then(|| Duration::try_from_secs_f64(left).ok()).flatten()
    }
}

/// Log lines of one stage.
#[derive(Debug)]
struct Lines {
    title: String,
    total: u64,
    /// Steps that were done before.
    from: u64,
    begun: Instant,
    /// Time of the last line.
    last: Option<Instant>,
}

impl Lines {
    fn new(title: &str, [from, total]: [u64; 2], now: Instant) -> Self {
        Self { title: title.into(), total, from, begun: now, last: None }
    }

    /// The line for `done` steps, if one is due; with the time that is left in all.
    fn set(&mut self, now: Instant, done: u64, in_all: Option<Duration>, message: &str) -> Option<String> {
        let elapsed = now.duration_since(self.begun);
        let due = match self.last {
            None => elapsed >= FIRST_LINE,
            Some(last) => now.duration_since(last) >= BETWEEN_LINES,
        };
        if !due {
            return None;
        }
        self.last = Some(now);
        let Self { title, total, from, .. } = self;
        let left = elapsed.as_secs_f64() * total.saturating_sub(done) as f64 / done.saturating_sub(*from) as f64;
        // no estimate without progress, or if it exceeds the clock's range
        let left = Duration::try_from_secs_f64(left).map(|left| format!(", about {} left", clock(left)));
        let line = match (u128::from(done.min(*total)) * 100).checked_div(u128::from(*total)) {
            None => format!("{title}: {done} steps, {}", clock(elapsed)),
            Some(percent) => format!("{title}: {percent} %, {}{}", clock(elapsed), left.unwrap_or_default()),
        };
        let in_all = in_all.map_or(String::new(), |left| format!(", {} in all", clock(left)));
        Some(with_message(line + &in_all, message))
    }

    fn end(&self, now: Instant, message: &str) -> String {
        with_message(format!("{}: done in {}", self.title, clock(now.duration_since(self.begun))), message)
    }
}

fn with_message(line: String, message: &str) -> String {
    if message.is_empty() { line } else { format!("{line}: {message}") }
}

/// `42 s`, `3 min 07 s` or `2 h 05 min`.
pub(crate) fn clock(time: Duration) -> String {
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
        let mut lines = Lines::new("fit", [0, 400], begun);
        assert_eq!(lines.set(at(0.0), 0, None, ""), None);
        assert_eq!(lines.set(at(0.9), 8, None, "loss 3"), None);
        assert_eq!(lines.set(at(1.0), 10, None, "loss 2").unwrap(), "fit: 2 %, 1 s, about 39 s left: loss 2");
        assert_eq!(lines.set(at(5.9), 90, None, "loss 2"), None);
        let line = lines.set(at(10.0), 100, None, "loss 1").unwrap();
        assert_eq!(line, "fit: 25 %, 10 s, about 30 s left: loss 1");
        assert_eq!(lines.set(at(14.9), 150, None, ""), None, "five seconds count from the last line");
        assert_eq!(lines.set(at(100.0), 400, None, "").unwrap(), "fit: 100 %, 1 min 40 s, about 0 s left");
        assert_eq!(lines.end(at(7500.0), "ok"), "fit: done in 2 h 05 min: ok");
    }

    #[test]
    fn unknown_lengths_and_slow_first_steps_have_no_estimate() {
        let begun = Instant::now();
        let mut open = Lines::new("read", [0, 0], begun);
        assert_eq!(open.set(begun + Duration::from_secs(6), 3, None, "").unwrap(), "read: 3 steps, 6 s");
        let mut slow = Lines::new("fit", [0, 10], begun);
        assert_eq!(slow.set(begun + Duration::from_secs(187), 0, None, "").unwrap(), "fit: 0 %, 3 min 07 s");
        let mut over = Lines::new("fit", [0, 10], begun);
        assert_eq!(over.set(begun + Duration::from_secs(6), 12, None, "").unwrap(), "fit: 100 %, 6 s, about 0 s left");
    }

    #[test]
    fn stages_of_a_plan_are_numbered_and_say_what_is_left_in_all() {
        let begun = Instant::now();
        let at = |seconds: u64| begun + Duration::from_secs(seconds);
        let stages = [("shape", 10.0), ("velocity", 30.0), ("material", 60.0)];
        let planned = || Plan { stages: stages.map(|(title, share)| (title.to_owned(), share)).to_vec(), begun: None };
        let mut plan = planned();
        let shape = plan.begin("shape", [0, 100], at(0)).unwrap();
        assert_eq!((shape.number, shape.count), (1, 3));
        assert_eq!(shape.left(at(1), 1), None, "too early to tell");
        assert_eq!(shape.left(at(10), 50), Some(Duration::from_secs(190)));
        assert_eq!(plan.begin("something else", [0, 5], at(15)), None);
        let material = plan.begin("material", [0, 60], at(40)).unwrap();
        assert_eq!(material.left(at(50), 10), Some(Duration::from_secs(50)));
        // what a run that goes on had done before took no time here
        let mut resumed = planned();
        let velocity = resumed.begin("velocity", [0, 3], at(100)).unwrap();
        assert_eq!(velocity.left(at(110), 1), Some(Duration::from_secs(80)));
        let mut halfway = planned();
        let material = halfway.begin("material", [30, 60], at(0)).unwrap();
        assert_eq!(material.left(at(10), 45), Some(Duration::from_secs(10)));
        let mut lines = Lines::new("stage 2 of 3: velocity", [0, 3], at(100));
        let line = lines.set(at(110), 1, velocity.left(at(110), 1), "").unwrap();
        assert_eq!(line, "stage 2 of 3: velocity: 33 %, 10 s, about 20 s left, 1 min 20 s in all");
    }
}
