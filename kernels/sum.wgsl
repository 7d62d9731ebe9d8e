// Sums over some axes. The elements behind one sum are cut into spans; each span gives one partial sum, laid out as
// [spans, sums], and the host adds those up with the same kernels until one span is left.
//
// `rows` gives each span to one invocation, which adds blocks of 16; `tree` gives each to one workgroup, whose
// invocations add up 16 elements each and then halve their number. The order depends on nothing but the shape.
#import "shared/linear.wgsl"

// Elements of one span; the host reads them from here.
const ROWS_SPAN: u32 = 256u;
const TREE_SPAN: u32 = 4096u;

// Twin of Sum::forward_gpu. Axes hold size and step; the outermost comes first.
struct Layout {
    // number of sums, of elements behind each, and of spans these are cut into
    sums: u32,
    count: u32,
    spans: u32,
    kept_rank: u32,
    summed_rank: u32,
    kept: array<vec4<u32>, 8>,
    summed: array<vec4<u32>, 8>,
}

@group(0) @binding(0) var<uniform> sizes: Layout;
@group(0) @binding(1) var<storage, read_write> y: array<f32>;
@group(0) @binding(2) var<storage, read> x: array<f32>;

// Where the elements behind one sum begin.
fn base_of(sum: u32) -> u32 {
    var rest = sum;
    var place = 0u;
    for (var axis = sizes.kept_rank; axis > 0u; axis--) {
        let extent = sizes.kept[axis - 1u];
        place += rest % extent.x * extent.y;
        rest /= extent.x;
    }
    return place;
}

// The element behind a sum with this number among them.
fn element(base: u32, number: u32) -> f32 {
    var rest = number;
    var place = base;
    for (var axis = sizes.summed_rank; axis > 0u; axis--) {
        let extent = sizes.summed[axis - 1u];
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
    if i >= sizes.sums * sizes.spans {
        return;
    }
    let base = base_of(i % sizes.sums);
    let begin = i / sizes.sums * ROWS_SPAN;
    let end = min(begin + ROWS_SPAN, sizes.count);
    var total = 0.0;
    for (var block = begin; block < end; block += 16u) {
        var part = 0.0;
        for (var number = block; number < min(block + 16u, end); number++) {
            part += element(base, number);
        }
        total += part;
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
    if i >= sizes.sums * sizes.spans {
        return;
    }
    let base = base_of(i % sizes.sums);
    let begin = i / sizes.sums * TREE_SPAN;
    let end = min(begin + TREE_SPAN, sizes.count);
    var part = 0.0;
    for (var number = begin + local; number < end; number += WORKGROUP) {
        part += element(base, number);
    }
    parts[local] = part;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            parts[local] += parts[local + half];
        }
    }
    if local == 0u {
        y[i] = parts[0];
    }
}
