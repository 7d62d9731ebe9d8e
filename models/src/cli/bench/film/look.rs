//! What `check` makes of a film, in a process of its own.

use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use gradreel::{Error, Result};
use serde_json::Value;

use crate::runtime::interrupt;

/// Time between two looks at a process.
const PAUSE: Duration = Duration::from_millis(20);

/// Maximum length of a reason in a table, in characters.
const LONGEST: usize = 200;

/// What came of it.
pub(super) struct Looked {
    pub accepted: bool,
    /// Exit status; none if it was given up.
    pub exit_code: Option<i32>,
    /// Why it was refused.
    pub reason: Option<String>,
    pub seconds: f64,
    /// What `check --json` said.
    pub seen: Value,
}

/// Looks at a film; its page goes into the folder `page`. It is given up after `limit` seconds.
pub(super) fn looked(film: &Path, page: &Path, limit: u64) -> Result<Looked> {
    let program = std::env::current_exe().map_err(|e| Error::io(film, "find the program itself", &e))?;
    let started = Instant::now();
    let mut child = Command::new(program)
        .arg("check")
        .arg(film)
        .arg("--json")
        .arg("--out")
        .arg(page)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|e| Error::io(film, "look at the film", &e))?;
    let mut stdout = child.stdout.take().expect("piped");
    let reader = std::thread::spawn(move || {
        let mut text = Vec::new();
        // what came before a read error is judged below
        let _ = stdout.read_to_end(&mut text);
        text
    });
    let status = loop {
        match child.try_wait().map_err(|e| Error::io(film, "look at the film", &e))? {
            Some(status) => break Some(status),
            None if started.elapsed() > Duration::from_secs(limit) || interrupt::requested() => {
                // it may have ended in the meantime
                let _ = child.kill();
                let _ = child.wait();
                break None;
            }
            None => std::thread::sleep(PAUSE),
        }
    };
    let seconds = started.elapsed().as_secs_f64();
    let seen: Value = serde_json::from_slice(&reader.join().unwrap_or_default()).unwrap_or(Value::Null);
    let accepted = status.is_some_and(|status| status.success());
    let reason = match (&status, accepted) {
        (_, true) => None,
        (None, _) => Some(format!("no answer within {limit} s")),
        (Some(status), _) => {
            let said: Vec<&str> = seen["problems"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
            Some(if said.is_empty() { format!("no word why ({status})") } else { said.join("; ") })
        }
    };
    let exit_code = status.and_then(|status| status.code());
    Ok(Looked { accepted, exit_code, reason, seconds, seen })
}

/// Whether a diameter \[m\] is within the interval that was seen, if there is one.
pub(super) fn holds(seen: &Value, diameter: f64) -> Option<bool> {
    let ends = &seen["interval_90"]["diameter_m"];
    Some(ends[0].as_f64()? <= diameter && diameter <= ends[1].as_f64()?)
}

/// A reason in one line: what failed, and what was found.
pub(super) fn brief(reason: &str) -> String {
    let mut lines = reason.lines();
    let what = lines.next().unwrap_or_default().trim();
    let found = lines.find_map(|line| line.trim().strip_prefix("found: "));
    let line = found.map_or_else(|| what.to_owned(), |found| format!("{what} ({found})"));
    match line.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &line[..end]),
        None => line,
    }
}
