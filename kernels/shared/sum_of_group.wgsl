// The sum of one number from each invocation of a workgroup, along a tree. Every invocation must call it. Needs
// shared/linear.wgsl.
var<workgroup> parts_of_sum: array<f32, WORKGROUP>;

fn sum_of_group(local: u32, part: f32) -> f32 {
    workgroupBarrier();
    parts_of_sum[local] = part;
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            parts_of_sum[local] += parts_of_sum[local + half];
        }
    }
    workgroupBarrier();
    return parts_of_sum[0];
}
