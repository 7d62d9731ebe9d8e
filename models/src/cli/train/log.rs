//! Log of a training: one row per step and per validation.

use gradreel::Result;

use crate::runtime::run_folder::RunFolder;

const STEPS: &str = "log.csv";
const LOOKS: &str = "validation.csv";

/// Two tables whose first column is the number of completed steps.
pub(super) struct Log {
    steps: String,
    looks: String,
}

impl Log {
    /// Empty tables with these names of the columns after the step, separated by commas.
    pub fn new([steps, looks]: [&str; 2]) -> Self {
        Self { steps: head(steps), looks: head(looks) }
    }

    /// The tables of a folder up to the step of its checkpoint.
    pub fn open(folder: &RunFolder, [steps, looks]: [&str; 2], made: u64) -> Result<Self> {
        let table = |name: &str, columns: &str| -> Result<String> {
            if !folder.has(name) {
                return Ok(head(columns));
            }
            let text = folder.read_text(name)?;
            let rows = text.lines().skip(1).filter(|row| step_of(row).is_some_and(|step| step <= made));
            Ok(rows.fold(head(columns), |table, row| table + row + "\n"))
        };
        Ok(Self { steps: table(STEPS, steps)?, looks: table(LOOKS, looks)? })
    }

    /// Adds a step.
    pub fn step(&mut self, step: u64, values: &[f64]) {
        self.steps += &row(step, values);
    }

    /// Adds a validation.
    pub fn look(&mut self, step: u64, values: &[f64]) {
        self.looks += &row(step, values);
    }

    /// Whether the model was validated at this step.
    pub fn looked(&self, step: u64) -> bool {
        self.looks.lines().any(|row| step_of(row) == Some(step))
    }

    /// Rows of the step table as numbers.
    pub fn steps(&self) -> Vec<Vec<f64>> {
        numbers(&self.steps)
    }

    /// Rows of the validation table as numbers.
    pub fn looks(&self) -> Vec<Vec<f64>> {
        numbers(&self.looks)
    }

    pub fn write(&self, folder: &RunFolder) -> Result<()> {
        folder.write(STEPS, self.steps.as_bytes())?;
        folder.write(LOOKS, self.looks.as_bytes())
    }
}

fn head(columns: &str) -> String {
    format!("step,{columns}\n")
}

fn row(step: u64, values: &[f64]) -> String {
    values.iter().fold(step.to_string(), |row, value| format!("{row},{value}")) + "\n"
}

fn numbers(table: &str) -> Vec<Vec<f64>> {
    table.lines().skip(1).map(|row| row.split(',').filter_map(|cell| cell.parse().ok()).collect()).collect()
}

fn step_of(row: &str) -> Option<u64> {
    row.split(',').next()?.parse().ok()
}
