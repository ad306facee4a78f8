// The buffers of the passes. One invocation is one mass point, and one workgroup 16 x 16 x 1 of
// them. The third dimension of a dispatch is the member of a batch:
//
//   dispatch id (x, y) = workgroup (x, y) * 16 + local id (x, y)        row = y, column = x
//   index              = y * width + x                                  width = columns
//
// A state is six planes (x, y, z, vx, vy, vz) of one value a point, member after member. So
// neighbouring invocations read neighbouring memory. `real` is the arithmetic of a step, `wide`
// that of a response after it.

// Absent features are compiled out: the host sets these constants when it makes a pipeline. The
// host also writes the aliases `real` and `wide`, `keep`, the springs and the numbers that it
// shares with the core (shader.py).
override stage: u32 = 1u;
override spring_damping: bool = true;
override drag: bool = true;
override mass_per_point: bool = true;
override pinned: bool = true;
override moving: bool = true;  // obstacles move: each step has `contacts` of its own

struct Constants {
    half_h: real, h: real, h2_6: real, h_6: real,
    rows: u32, columns: u32,
    parameter_stride: u32,       // from member to member; 0: they share one scene
    contact_member_stride: u32,  // likewise
    contact_step_stride: u32,    // from step to step
    zero: u32,                   // 0; no compiler knows
    members: u32,
}

// `parameters` has for a member gravity (3), drag and the largest speed. From `first_spring` on
// follow stiffness, rest length and damping of each kind of spring; from `first_weight` on one
// weight a point, 0 where it is pinned, else 1/mass.
@group(0) @binding(0) var<uniform> constants: Constants;
@group(0) @binding(1) var<storage, read_write> state: array<real>;
@group(0) @binding(2) var<storage, read_write> compensation: array<real>;
@group(0) @binding(3) var<storage, read_write> stage_a: array<real>;
@group(0) @binding(4) var<storage, read_write> stage_b: array<real>;
// These are three planes of the first stage's accelerations, and three of the sum of the second's
// and third's.
@group(0) @binding(5) var<storage, read_write> accelerations: array<real>;
@group(0) @binding(6) var<storage, read> parameters: array<real>;
@group(0) @binding(7) var<storage, read> contacts: array<wide>;
// The first value counts first and third stages since the host set it to 0. Then follow a value of
// every member for each of FINDINGS (shader.py), and at the end the number of its responses.
@group(0) @binding(8) var<storage, read_write> results: array<atomic<u32>>;

// Counts whole steps, from the fourth stage on with the present one, whether or not the counting
// invocation was here before.
fn steps_done() -> u32 { return (atomicLoad(&results[0]) - u32(stage == 3u)) / 2u; }

fn points() -> u32 { return constants.rows * constants.columns; }
fn inside(id: vec3<u32>) -> bool { return id.x < constants.columns && id.y < constants.rows; }

fn note_value(finding: u32, member: u32, value: u32) {
    atomicMin(&results[1u + finding * constants.members + member], value);
}
fn note(finding: u32, id: vec3<u32>) {
    note_value(finding, id.z, id.y * constants.columns + id.x);
}
fn count_response(member: u32) {
    atomicAdd(&results[1u + findings * constants.members + member], 1u);
}

// Returns the index of a point's value in the first plane.
fn place(id: vec3<u32>) -> u32 { return id.z * 6u * points() + id.y * constants.columns + id.x; }
