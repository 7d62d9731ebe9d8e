// Sums, products and extrema over some axes. The elements behind one result are cut into spans; each span gives one
// partial result, laid out as [spans, results], and the host joins those with the same kernels until one span is left.
//
// `rows` gives each span to one invocation, which joins blocks of 16; `tree` gives each to one workgroup, whose
// invocations join 16 elements each and then halve their number. The order depends on nothing but the shape.
#import "shared/linear.wgsl"
#import "shared/is_nan.wgsl"
#import "shared/max.wgsl"
#import "shared/min.wgsl"

// Elements of one span; the host reads them from here.
const ROWS_SPAN: u32 = 256u;
const TREE_SPAN: u32 = 4096u;

// Twin of Axes::on_gpu. Axes hold size and step; the outermost comes first.
struct Layout {
    // number of results, of elements behind each, and of spans these are cut into
    results: u32,
    count: u32,
    spans: u32,
    kept_rank: u32,
    dropped_rank: u32,
    // 0: sum, 1: larger, 2: smaller, 3: product
    join: u32,
    // the bits of the number that changes nothing
    neutral: u32,
    kept: array<vec4<u32>, 8>,
    dropped: array<vec4<u32>, 8>,
}

@group(0) @binding(0) var<uniform> sizes: Layout;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;

fn join(a: f32, b: f32) -> f32 {
    switch sizes.join {
        case 1u: { return scalar_max(a, b); }
        case 2u: { return scalar_min(a, b); }
        case 3u: { return a * b; }
        default: { return a + b; }
    }
}

// Where the elements behind one result begin.
fn base_of(result: u32) -> u32 {
    var rest = result;
    var place = 0u;
    for (var axis = sizes.kept_rank; axis > 0u; axis--) {
        let extent = sizes.kept[axis - 1u];
        place += rest % extent.x * extent.y;
        rest /= extent.x;
    }
    return place;
}

// The element behind a result with this number among them.
fn element(base: u32, number: u32) -> f32 {
    var rest = number;
    var place = base;
    for (var axis = sizes.dropped_rank; axis > 0u; axis--) {
        let extent = sizes.dropped[axis - 1u];
        place += rest % extent.x * extent.y;
        rest /= extent.x;
    }
    return x[place];
}

@compute @workgroup_size(WORKGROUP)
fn rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups) * WORKGROUP + local;
    if i >= sizes.results * sizes.spans {
        return;
    }
    let base = base_of(i % sizes.results);
    let begin = i / sizes.results * ROWS_SPAN;
    let end = min(begin + ROWS_SPAN, sizes.count);
    let neutral = bitcast<f32>(sizes.neutral);
    var total = neutral;
    for (var block = begin; block < end; block += 16u) {
        var part = neutral;
        for (var number = block; number < min(block + 16u, end); number++) {
            part = join(part, element(base, number));
        }
        total = join(total, part);
    }
    y[i] = total;
}

var<workgroup> parts: array<f32, WORKGROUP>;

@compute @workgroup_size(WORKGROUP)
fn tree(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = linear_group(group, groups);
    if i >= sizes.results * sizes.spans {
        return;
    }
    let base = base_of(i % sizes.results);
    let begin = i / sizes.results * TREE_SPAN;
    let end = min(begin + TREE_SPAN, sizes.count);
    var part = bitcast<f32>(sizes.neutral);
    for (var number = begin + local; number < end; number += WORKGROUP) {
        part = join(part, element(base, number));
    }
    parts[local] = part;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            parts[local] = join(parts[local], parts[local + half]);
        }
    }
    if local == 0u {
        y[i] = parts[0];
    }
}
