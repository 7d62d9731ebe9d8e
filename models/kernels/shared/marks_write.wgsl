// What substeps have left about themselves; see shared/grid.wgsl.
@group(0) @binding(1) var<storage, read_write> marks: array<atomic<u32>>;

fn mark(i: u32) -> u32 {
    return atomicLoad(&marks[i]);
}
