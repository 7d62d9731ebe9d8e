//! The kernels, assembled from `models/kernels/`: fragments of `shared/` first, then the file with the entry point.
//! `#import` lines include fragments of the core's `kernels/shared/`.

use gradreel::backend::gpu::Kernel;

/// The concatenated text of files under `models/kernels/`.
macro_rules! text {
    ($($file:literal),+ $(,)?) => {
        concat!($(include_str!(concat!("../../../kernels/", $file)), "\n"),+)
    };
}

macro_rules! kernels {
    ($($(#[$doc:meta])* $name:ident = $stem:literal, $entry:literal, [$($file:literal),+], [$($buffer:literal),+];)+) => {
        $($(#[$doc])* pub(super) static $name: Kernel =
            Kernel::new($stem, $entry, text!($($file),+), &[$($buffer),+]);)+

        /// All material-independent kernels.
        #[cfg(test)]
        pub(super) static ALL: &[&Kernel] = &[$(&$name),+];
    };
}

kernels! {
    /// Marks the box of cells of the first substep.
    SURVEY = "advance", "survey",
        ["shared/substep.wgsl", "shared/marks_write.wgsl", "shared/node_grid.wgsl", "shared/stencil.wgsl", "advance.wgsl"],
        ["marks", "now"];
    /// Counts the particles of each cell.
    COUNT = "sort", "count",
        ["shared/substep.wgsl", "shared/marks_write.wgsl", "shared/node_grid.wgsl", "sort.wgsl"],
        ["cells", "counts", "marks", "now"];
    /// Prefix sums within spans.
    SCAN = "sort", "scan",
        ["shared/substep.wgsl", "shared/marks_write.wgsl", "shared/node_grid.wgsl", "sort.wgsl"],
        ["sums", "totals", "numbers"];
    /// Lists the particles by cell.
    ARRIVE = "sort", "arrive",
        ["shared/substep.wgsl", "shared/marks_write.wgsl", "shared/node_grid.wgsl", "sort.wgsl"],
        ["arrivals", "cell_and_arrival", "starts", "bases"];
    /// The index of each particle in the sorted list.
    SETTLE = "sort", "settle",
        ["shared/substep.wgsl", "shared/marks_write.wgsl", "shared/node_grid.wgsl", "sort.wgsl"],
        ["slots", "cell_and_arrival", "starts", "bases", "arrived"];
    /// Particle to grid, gravity, obstacles.
    GRID = "grid", "main",
        ["shared/substep.wgsl", "shared/marks_read.wgsl", "shared/node_grid.wgsl", "shared/scatter.wgsl",
         "shared/contact.wgsl", "grid.wgsl"],
        ["grid", "counts", "marks", "starts", "bases", "records", "obstacles"];
    /// The adjoint of [`GRID`].
    GRID_VJP = "grid_vjp", "main",
        ["shared/substep.wgsl", "shared/marks_read.wgsl", "shared/node_grid.wgsl", "shared/scatter.wgsl",
         "shared/contact.wgsl", "grid_vjp.wgsl"],
        ["grid", "counts", "on_world", "marks", "starts", "bases", "records", "obstacles"];
    /// Grid to particle.
    ADVANCE = "advance", "main",
        ["shared/substep.wgsl", "shared/marks_write.wgsl", "shared/node_grid.wgsl", "shared/stencil.wgsl", "advance.wgsl"],
        ["next", "marks", "now", "grid"];
    /// The records that the adjoint of grid-to-particle scatters.
    LIFT = "lift", "main", ["shared/substep.wgsl", "lift.wgsl"], ["records", "cotangent", "slots"];
    /// The adjoint of both transfers.
    PULL = "pull", "main",
        ["shared/substep.wgsl", "shared/marks_read.wgsl", "shared/node_grid.wgsl", "shared/stencil.wgsl", "pull.wgsl"],
        ["cotangent", "on_record", "marks", "now", "slots", "records", "grid"];
    /// Copies the positions of a state to a frame.
    SHOW = "frames", "show", ["shared/substep.wgsl", "frames.wgsl"], ["frames", "labels", "now"];
    /// Adds the cotangents of a frame to the cotangent of a state.
    ADD = "frames", "add", ["shared/substep.wgsl", "frames.wgsl"], ["cotangent", "labels", "on_frames"];
}

/// The text around the kernel of a material; see `law.rs`.
pub(super) const MATERIAL: (&str, &[&str]) = (
    text!["shared/substep.wgsl", "shared/marks_write.wgsl", "shared/node_grid.wgsl", "material.wgsl"],
    &["next", "records", "marks", "now", "slots", "values"],
);

/// The text around the adjoint kernel of a material.
pub(super) const MATERIAL_VJP: (&str, &[&str]) =
    (text!["shared/substep.wgsl", "material_vjp.wgsl"], &["cotangent", "on_values", "now", "values", "on_record"]);

#[cfg(test)]
mod tests {
    use super::super::law::LawKernels;
    use super::*;
    use crate::physics::materials;

    fn check(kernel: &Kernel) {
        let module = kernel.reflect().unwrap_or_else(|error| panic!("{error}"));
        assert!(module.buffers().len() <= 8 && module.invocations() <= 256, "{} {}", kernel.name(), kernel.entry());
        assert_eq!(module.parameters().map(|(_, bytes)| bytes), Some(4 * super::super::words::COUNT));
    }

    #[test]
    fn every_kernel_is_valid_within_the_limits_of_web_gpu() {
        ALL.iter().for_each(|kernel| check(kernel));
        for law in materials::all() {
            let LawKernels { forward, reverse } = LawKernels::of(&law);
            check(&forward);
            check(&reverse);
        }
    }
}
