// Lists particles by cell, and by their number within a cell: a counting sort. Atomics count, but decide nothing: the place
// of a particle within its cell is the number of smaller ones there.

// Cells of one span; the host reads it from here.
const SPAN: u32 = 4096u;
const EACH: u32 = 16u;

@group(0) @binding(2) var<storage, read> now: array<f32>;
// cell, and number of arrival there
@group(0) @binding(3) var<storage, read_write> cells: array<u32>;
@group(0) @binding(4) var<storage, read_write> counts: array<atomic<u32>>;

@compute @workgroup_size(WORKGROUP)
fn count(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    let node_grid = node_grid_now();
    if p == 0u && node_grid.sound && !node_grid.fits {
        atomicMin(&marks[0], substep.step);
    }
    if p >= substep.particles || !node_grid.sound || !node_grid.fits {
        return;
    }
    let cell = node_number(node_grid, cell_of(node_grid, vec3<f32>(now[place(0u, p)], now[place(1u, p)], now[place(2u, p)])));
    cells[2u * p] = cell;
    cells[2u * p + 1u] = atomicAdd(&counts[cell], 1u);
}

@group(0) @binding(5) var<storage, read> numbers: array<u32>;
@group(0) @binding(6) var<storage, read_write> sums: array<u32>;
@group(0) @binding(7) var<storage, read_write> totals: array<u32>;

var<workgroup> partial: array<u32, WORKGROUP>;

// Sums of the numbers before each one within its span, and the total of each span.
@compute @workgroup_size(WORKGROUP)
fn scan(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let span = linear_group(group, groups);
    let begin = span * SPAN + local * EACH;
    let end = min(begin + EACH, substep.capacity);
    var own = 0u;
    for (var i = begin; i < end; i++) {
        own += numbers[i];
    }
    partial[local] = own;
    for (var distance = 1u; distance < WORKGROUP; distance *= 2u) {
        workgroupBarrier();
        var before = 0u;
        if local >= distance {
            before = partial[local - distance];
        }
        workgroupBarrier();
        partial[local] += before;
    }
    var sum = partial[local] - own;
    for (var i = begin; i < end; i++) {
        sums[i] = sum;
        sum += numbers[i];
    }
    if local == WORKGROUP - 1u && span * SPAN < substep.capacity {
        totals[span] = partial[local];
    }
}

@group(0) @binding(8) var<storage, read> cell_and_arrival: array<u32>;
@group(0) @binding(9) var<storage, read> starts: array<u32>;
@group(0) @binding(10) var<storage, read> bases: array<u32>;
@group(0) @binding(11) var<storage, read_write> arrivals: array<u32>;

fn start_of(cell: u32) -> u32 {
    return starts[cell] + bases[cell / SPAN];
}

// Particles by cell, in the order of their arrival.
@compute @workgroup_size(WORKGROUP)
fn arrive(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    if p < substep.particles {
        arrivals[start_of(cell_and_arrival[2u * p]) + cell_and_arrival[2u * p + 1u]] = p;
    }
}

@group(0) @binding(12) var<storage, read> arrived: array<u32>;
@group(0) @binding(13) var<storage, read_write> slots: array<u32>;

// The place of each particle in the list that is sorted within cells, too.
@compute @workgroup_size(WORKGROUP)
fn settle(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let p = linear_group(group, groups) * WORKGROUP + local;
    if p >= substep.particles {
        return;
    }
    let cell = cell_and_arrival[2u * p];
    let begin = start_of(cell);
    var slot = begin;
    for (var k = begin; k < start_of(cell + 1u); k++) {
        slot += select(0u, 1u, arrived[k] < p);
    }
    slots[p] = slot;
}
