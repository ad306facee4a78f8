// Double precision: float64 throughout, nothing to compensate.
alias real = f64;
alias wide = f64;
const compensated = false;

// As in single.wgsl.
fn keep(a: f64) -> f64 {
    return bitcast<f64>(bitcast<u64>(a) | u64(constants.zero));
}

fn keep_wide(a: f64) -> f64 {
    return keep(a);
}

fn is_finite(a: f64) -> bool {
    return (u32(bitcast<u64>(a) >> 32u) & 0x7ff00000u) != 0x7ff00000u;
}

fn widened(value: vec3<f64>, low: vec3<f64>) -> vec3<f64> {
    return value;
}

fn narrowed(position: vec3<f64>, velocity: vec3<f64>) -> Body {
    return Body(position, vec3<f64>(), velocity, vec3<f64>());
}

fn position_from(body: Body, contact: Contact) -> vec3<f64> {
    return body.position - contact.center;
}

fn velocity_of(body: Body) -> vec3<f64> {
    return body.velocity;
}

fn answered(body: Body, contact: Contact, answer: Answer) -> Body {
    var result = body;
    if (answer.moved) {
        result.position = contact.center + answer.on_surface;
    }
    result.velocity = answer.velocity;
    return result;
}
