// Every invocation writes who it is, at the index that it computes.
struct Shape {
    rows: u32,
    columns: u32,
}

@group(0) @binding(0) var<uniform> shape: Shape;
@group(0) @binding(1) var<storage, read_write> ids: array<u32>;

@compute @workgroup_size(16, 16, 1)
fn thread_ids(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) thread: vec3<u32>,
    @builtin(global_invocation_id) dispatch: vec3<u32>,
) {
    if (dispatch.x >= shape.columns || dispatch.y >= shape.rows) {
        return;
    }
    let index = dispatch.y * shape.columns + dispatch.x;
    let at = 7u * index;
    ids[at] = group.x;
    ids[at + 1u] = group.y;
    ids[at + 2u] = thread.x;
    ids[at + 3u] = thread.y;
    ids[at + 4u] = dispatch.x;
    ids[at + 5u] = dispatch.y;
    ids[at + 6u] = index;
}
