//! The voxels of a run as a file, which says itself how far their fit is: there is no moment between two files at which an
//! interruption would make them contradict each other.

use gradreel::io::safetensors::TensorFile;
use gradreel::ops::NodeGrid;
use gradreel::optim::{Adam, Params};
use gradreel::{Result, Tensor};
use serde::{Deserialize, Serialize};

use crate::field::Field;
use crate::identify::model::with_voxels::UNKNOWNS;
use crate::identify::run::damaged;
use crate::identify::{Run, Stage};

pub(in crate::identify) const FIELD: &str = "field.safetensors";
const KEPT_FIELD: &str = "field_before_motion.safetensors";

/// How far the voxels of a file are.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reached {
    /// The stage that wrote them.
    pub stage: Stage,
    /// Iterations of its fit that are done.
    pub iterations: usize,
    /// Whether the fit has ended.
    pub ended: bool,
}

/// What the file says beside its tensors.
#[derive(Serialize, Deserialize)]
struct Header {
    /// Origin \[m\], spacing \[m\] and numbers of nodes.
    node_grid: ([f64; 3], f64, [usize; 3]),
    reached: Reached,
}

const HEADER: &str = "field";

impl Run {
    fn field_file(&self, name: &str) -> Result<TensorFile> {
        TensorFile::from_bytes(&self.folder.read(name)?).map_err(|e| damaged(&self.folder, name, &e))
    }

    fn header(&self, file: &TensorFile) -> Result<Header> {
        let text = file.metadata.get(HEADER).map_or("", String::as_str);
        serde_json::from_str(text).map_err(|e| damaged(&self.folder, FIELD, &e))
    }

    /// How far the stage is with its voxels; nothing where the file is of another stage or there is none.
    ///
    /// # Errors
    /// [`ErrorKind::Input`](gradreel::ErrorKind::Input) when the file is damaged.
    pub fn reached(&self, stage: Stage) -> Result<Reached> {
        let nothing = Reached { stage, ..Reached::default() };
        if !self.folder.has(FIELD) {
            return Ok(nothing);
        }
        let reached = self.header(&self.field_file(FIELD)?)?.reached;
        Ok(if reached.stage == stage { reached } else { nothing })
    }

    /// Writes the voxels with their raw values, what they have reached, and the optimiser if a fit is under way.
    ///
    /// # Errors
    /// What writing returns.
    pub fn save_field(&self, field: &Field, params: &Params, adam: Option<&Adam>, reached: &Reached) -> Result<()> {
        let NodeGrid { origin, spacing, dims } = field.node_grid;
        let mut file = TensorFile::default();
        // one entry, because several would be written in any order: the same voxels are the same file
        let header = Header { node_grid: (origin, spacing, dims), reached: reached.clone() };
        file.metadata.insert(HEADER.into(), serde_json::to_string(&header).expect("names and numbers"));
        file.tensors.insert("voxels".into(), Tensor::from_vec(field.voxels.clone(), [field.len()]));
        file.tensors.extend(params.iter().map(|(path, value)| (path.to_owned(), value.clone())));
        if let Some(adam) = adam {
            adam.save(&mut file);
        }
        self.folder.write(FIELD, &file.to_bytes()?)
    }

    /// Keeps a copy of the voxels as they are.
    ///
    /// # Errors
    /// What reading and writing return.
    pub fn keep_field(&self) -> Result<()> {
        self.folder.write(KEPT_FIELD, &self.folder.read(FIELD)?)
    }

    /// Goes back to the copy that [`Run::keep_field`] made.
    ///
    /// # Errors
    /// What reading and writing return.
    pub fn restore_field(&self) -> Result<()> {
        self.folder.write(FIELD, &self.folder.read(KEPT_FIELD)?)
    }

    /// Reads what [`Run::save_field`] wrote; the optimiser goes on if its state is there.
    ///
    /// # Errors
    /// [`ErrorKind::Input`](gradreel::ErrorKind::Input) when the file is missing or damaged.
    pub fn load_field(&self, adam: &mut Adam) -> Result<(Field, Params)> {
        self.load_field_of(FIELD, adam)
    }

    /// The voxels that [`Run::keep_field`] kept.
    ///
    /// # Errors
    /// As [`Run::load_field`].
    pub fn load_kept_field(&self) -> Result<(Field, Params)> {
        self.load_field_of(KEPT_FIELD, &mut Adam::new(0.0))
    }

    fn load_field_of(&self, name: &str, adam: &mut Adam) -> Result<(Field, Params)> {
        let file = self.field_file(name)?;
        let (origin, spacing, dims) = self.header(&file)?.node_grid;
        let node_grid = NodeGrid { origin, spacing, dims };
        for name in ["voxels", "field.density", "field.colour"] {
            file.get(name).map_err(|e| damaged(&self.folder, FIELD, &e))?;
        }
        let voxels = file.get("voxels")?;
        let nodes = dims.iter().try_fold(1usize, |n, d| n.checked_mul(*d)).unwrap_or(0);
        let fits = voxels.dtype() == gradreel::DType::U32
            && voxels.slice::<u32>().iter().all(|v| (*v as usize) < nodes)
            && file.get("field.density")?.dims() == [voxels.len(), 1]
            && file.get("field.colour")?.dims() == [voxels.len(), 3];
        if !fits {
            return Err(damaged(&self.folder, FIELD, &"tensors that do not belong together"));
        }
        if Adam::is_saved_in(&file) {
            adam.restore(&file).map_err(|e| damaged(&self.folder, FIELD, &e))?;
        }
        let field = Field { node_grid, voxels: voxels.slice::<u32>().to_vec() };
        let kept = |path: &str| path.starts_with("field.") || path == UNKNOWNS;
        let params = file.tensors.into_iter().filter(|(path, _)| kept(path)).collect();
        Ok((field, params))
    }
}
