// One operation of a and b, for every pair of numbers. T and OUT are filled in by probe.py.
@group(0) @binding(0) var<uniform> z: u32;
@group(0) @binding(1) var<storage, read> first: array<T>;
@group(0) @binding(2) var<storage, read> second: array<T>;
@group(0) @binding(3) var<storage, read_write> out: array<T>;

@compute @workgroup_size(256, 1, 1)
fn probe(@builtin(global_invocation_id) id: vec3<u32>) {
    let a = first[id.x];
    let b = second[id.x];
    let n = arrayLength(&first);
    OUT
}
