//! Log of a training: one row per step and per validation.

use gradreel::Result;
use gradreel::optim::Update;

use crate::runtime::run_folder::RunFolder;
use crate::views::Score;

const STEPS: &str = "log.csv";
const LOOKS: &str = "validation.csv";
const STEPS_HEAD: &str = "step,loss,rate,gradient_norm\n";
const LOOKS_HEAD: &str = "step,loss,centre_error,box_iou,psnr_db,silhouette_iou\n";

/// Two tables whose first column is the number of completed steps.
pub(super) struct Log {
    steps: String,
    looks: String,
}

impl Log {
    pub fn new() -> Self {
        Self { steps: STEPS_HEAD.to_owned(), looks: LOOKS_HEAD.to_owned() }
    }

    /// The tables of a folder up to the step of its checkpoint.
    pub fn open(folder: &RunFolder, made: u64) -> Result<Self> {
        let table = |name: &str, head: &str| -> Result<String> {
            if !folder.has(name) {
                return Ok(head.to_owned());
            }
            let text = folder.read_text(name)?;
            let rows = text.lines().skip(1).filter(|row| step_of(row).is_some_and(|step| step <= made));
            Ok(rows.fold(head.to_owned(), |table, row| table + row + "\n"))
        };
        Ok(Self { steps: table(STEPS, STEPS_HEAD)?, looks: table(LOOKS, LOOKS_HEAD)? })
    }

    pub fn step(&mut self, loss: f64, update: &Update) {
        self.steps += &format!("{},{loss},{},{}\n", update.step, update.rate, update.gradient_norm);
    }

    pub fn look(&mut self, step: u64, loss: f64, score: &Score) {
        let Score { centre, overlap, psnr, silhouette } = score;
        self.looks += &format!("{step},{loss},{centre},{overlap},{psnr},{silhouette}\n");
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

fn numbers(table: &str) -> Vec<Vec<f64>> {
    table.lines().skip(1).map(|row| row.split(',').filter_map(|cell| cell.parse().ok()).collect()).collect()
}

fn step_of(row: &str) -> Option<u64> {
    row.split(',').next()?.parse().ok()
}
