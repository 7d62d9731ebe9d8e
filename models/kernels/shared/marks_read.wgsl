// What substeps have left about themselves, read only; see shared/grid.wgsl.
@group(0) @binding(1) var<storage, read> marks: array<u32>;

fn mark(i: u32) -> u32 {
    return marks[i];
}
