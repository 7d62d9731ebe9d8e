// y = a b (+ bias of each column) for batches of matrices whose elements lie at any steps, so that either may be read
// transposed, or once for several batches.
//
// A workgroup makes a tile of TILE x TILE elements of y: slabs of a and b of depth DEPTH go through workgroup memory
// (8 KiB), and each of the 16 x 16 invocations keeps a block of 4 x 4 in registers. Places outside the matrices count
// as 0.
#import "shared/linear.wgsl"

// The host reads them from here.
const TILE: u32 = 64u;
const DEPTH: u32 = 16u;
// Axes of the batch.
const AXES: u32 = 4u;

// Twin of Product::launch.
struct Sizes {
    // [m,k] times [k,n], `batch` times
    batch: u32,
    m: u32,
    k: u32,
    n: u32,
    // distances between neighbours along a row's and a column's index
    a_row: u32,
    a_column: u32,
    b_row: u32,
    b_column: u32,
    // size of each axis of the batch, outermost first, and the distance between its neighbours in a and in b
    axes: array<vec4<u32>, AXES>,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> a: array<f32>;
@group(0) @binding(3) var<storage, read> b: array<f32>;
@group(0) @binding(4) var<storage, read> bias: array<f32>;

// a is kept as [DEPTH, TILE] so that an invocation reads its four rows as neighbours.
var<workgroup> a_slab: array<f32, TILE * DEPTH>;
var<workgroup> b_slab: array<f32, TILE * DEPTH>;

// The place in a slab (x: along the tile, y: along the depth) that an invocation fills in turn `turn`, such that
// neighbouring invocations read neighbouring elements.
fn slab_place(local: u32, turn: u32, depth_is_contiguous: bool) -> vec2<u32> {
    let number = turn * WORKGROUP + local;
    if depth_is_contiguous {
        return vec2(number / DEPTH, number % DEPTH);
    }
    return vec2(number % TILE, number / TILE);
}

// What one invocation makes.
struct Block {
    // the first row of y, counted over all matrices, and the first column
    row: u32,
    column: u32,
    // rows that belong to the matrix; 0 beyond the batch
    rows: u32,
    values: array<vec4<f32>, 4>,
}

fn block_of(tile: u32, local: u32) -> Block {
    var block: Block;
    let across = (sizes.n + TILE - 1u) / TILE;
    let down = (sizes.m + TILE - 1u) / TILE;
    let matrix = tile / (across * down);
    if matrix >= sizes.batch {
        return block;
    }
    var a_start = 0u;
    var b_start = 0u;
    var rest = matrix;
    for (var i = 0u; i < AXES; i++) {
        let axis = sizes.axes[AXES - 1u - i];
        let index = rest % axis.x;
        rest /= axis.x;
        a_start += index * axis.y;
        b_start += index * axis.z;
    }
    let first_row = tile / across % down * TILE;
    let first_column = tile % across * TILE;
    let my_row = local / 16u * 4u;
    let my_column = local % 16u * 4u;
    for (var depth = 0u; depth < sizes.k; depth += DEPTH) {
        for (var turn = 0u; turn < TILE * DEPTH / WORKGROUP; turn++) {
            let pa = slab_place(local, turn, sizes.a_column == 1u);
            let row = first_row + pa.x;
            let a_depth = depth + pa.y;
            var a_value = 0.0;
            if row < sizes.m && a_depth < sizes.k {
                a_value = a[a_start + row * sizes.a_row + a_depth * sizes.a_column];
            }
            a_slab[pa.y * TILE + pa.x] = a_value;
            let pb = slab_place(local, turn, sizes.b_row == 1u && sizes.b_column != 1u);
            let column = first_column + pb.x;
            let b_depth = depth + pb.y;
            var b_value = 0.0;
            if column < sizes.n && b_depth < sizes.k {
                b_value = b[b_start + b_depth * sizes.b_row + column * sizes.b_column];
            }
            b_slab[pb.y * TILE + pb.x] = b_value;
        }
        workgroupBarrier();
        for (var z = 0u; z < DEPTH; z++) {
            let at_a = z * TILE + my_row;
            let at_b = z * TILE + my_column;
            let right = vec4(b_slab[at_b], b_slab[at_b + 1u], b_slab[at_b + 2u], b_slab[at_b + 3u]);
            block.values[0] += a_slab[at_a] * right;
            block.values[1] += a_slab[at_a + 1u] * right;
            block.values[2] += a_slab[at_a + 2u] * right;
            block.values[3] += a_slab[at_a + 3u] * right;
        }
        workgroupBarrier();
    }
    let row = first_row + my_row;
    block.row = matrix * sizes.m + row;
    block.column = first_column + my_column;
    block.rows = min(sizes.m - min(sizes.m, row), 4u);
    return block;
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    var block = block_of(linear_group(group, groups), local);
    for (var i = 0u; i < block.rows; i++) {
        for (var j = 0u; j < 4u && block.column + j < sizes.n; j++) {
            y[(block.row + i) * sizes.n + block.column + j] = block.values[i][j];
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn biased(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    var block = block_of(linear_group(group, groups), local);
    for (var i = 0u; i < block.rows; i++) {
        for (var j = 0u; j < 4u && block.column + j < sizes.n; j++) {
            let column = block.column + j;
            y[(block.row + i) * sizes.n + column] = block.values[i][j] + bias[column];
        }
    }
}
