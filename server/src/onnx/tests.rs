use std::collections::HashMap;

use manduca_numerics::parameters::{Bounds, Point};

use super::*;

/// A table, row by row.
type Values = Vec<Vec<f64>>;

/// What a runtime does with the file, on one stroke: as few lines as its operators need.
fn run(file: &[u8], x: &Point) -> Vec<f64> {
    let graph = ModelProto::decode(file).expect("a model").graph.expect("a graph");
    let mut values: HashMap<String, Values> = HashMap::from([("parameters".to_owned(), vec![x.to_vec()])]);
    for tensor in &graph.initializer {
        let numbers: Vec<f64> = tensor
            .raw_data
            .as_chunks::<8>()
            .0
            .iter()
            .map(|b| match tensor.data_type {
                INT64 => i64::from_le_bytes(*b) as f64,
                _ => f64::from_le_bytes(*b),
            })
            .collect();
        let columns = tensor.dims.last().map_or(1, |n| *n as usize);
        values.insert(tensor.name.clone(), numbers.chunks(columns).map(<[f64]>::to_vec).collect());
    }
    for node in &graph.node {
        let of = |i: usize| &values[&node.input[i]];
        // The left operand has the shape of the result; one number, or one row, is repeated.
        let pairs = |f: &dyn Fn(f64, f64) -> f64| -> Values {
            let right = &of(1)[0];
            vec![of(0)[0].iter().enumerate().map(|(i, a)| f(*a, right[if right.len() == 1 { 0 } else { i }])).collect()]
        };
        let each = |f: &dyn Fn(f64) -> f64| -> Values { vec![of(0)[0].iter().map(|a| f(*a)).collect()] };
        let result = match node.op_type.as_str() {
            "Add" => pairs(&|a, b| a + b),
            "Sub" => pairs(&|a, b| a - b),
            "Mul" => pairs(&|a, b| a * b),
            "Div" => pairs(&|a, b| a / b),
            "Max" => pairs(&f64::max),
            "Log" => each(&manduca_numerics::math::ln),
            "Sin" => each(&manduca_numerics::math::sin),
            "Tanh" => each(&manduca_numerics::math::tanh),
            "Neg" => each(&|a| -a),
            "Identity" => each(&|a| a),
            "Gather" => vec![of(1)[0].iter().map(|i| of(0)[0][*i as usize]).collect()],
            "Concat" => vec![(0..node.input.len()).flat_map(|i| of(i)[0].clone()).collect()],
            "MatMul" => {
                let (a, b) = (&of(0)[0], of(1));
                vec![(0..b[0].len()).map(|c| a.iter().zip(b).map(|(a, row)| a * row[c]).sum()).collect()]
            }
            other => panic!("{other}"),
        };
        values.insert(node.output[0].clone(), result);
    }
    values["means"][0].clone()
}

fn network(seed: u64, bounds: &Bounds) -> Network {
    // Numbers without a pattern, the same on every machine.
    let mut state = seed;
    let mut draw = |n: usize| -> Vec<f64> {
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        (0..n).map(|_| next()).collect()
    };
    Network::new_checked(*bounds, draw(70), draw(7), draw(28), [0.1, -0.2, 0.3, 0.4]).expect("a network")
}

fn assert_alike(frame: Frame, members: usize) {
    let given = Bounds::default();
    let bounds = frame.bounds(&given);
    let networks = (0..members).map(|m| network(m as u64 + 1, &bounds)).collect();
    let surrogate = Surrogate::new(frame, networks).expect("a surrogate");
    let file = model(&surrogate, &Bounds::default(), "test", &[("study", "1".into())]).expect("networks");
    for share in [0.1, 0.37, 0.9] {
        let x = given.from_unit(&std::array::from_fn(|i| (share + 0.618 * i as f64).fract()));
        for (found, expected) in run(&file, &x).iter().zip(surrogate.predict(&x)) {
            assert!((found - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{found} against {expected}");
        }
    }
}

#[test]
fn a_model_computes_what_the_surrogate_predicts() {
    assert_alike(Frame::Paper, 1);
    assert_alike(Frame::Physical { reference_hz: 27.5, arm: [0.3, -0.7], mirror: false, sharpness: false }, 2);
    assert_alike(Frame::Physical { reference_hz: 27.5, arm: [0.3, -0.7], mirror: true, sharpness: true }, 3);
}

#[test]
fn a_model_tells_its_names_and_units() {
    let surrogate = Surrogate::of(network(1, &Bounds::default()));
    let file = model(&surrogate, &Bounds::default(), "test", &[("study", "abc".into())]).expect("networks");
    let model = ModelProto::decode(&file[..]).expect("a model");
    let told =
        |key: &str| model.metadata_props.iter().find(|p| p.key == key).map(|p| p.value.clone()).unwrap_or_default();
    assert_eq!(told("study"), "abc");
    let inputs: serde_json::Value = serde_json::from_str(&told("inputs")).expect("JSON");
    assert_eq!((&inputs[0]["name"], &inputs[0]["unit"]), (&json!("frequency_hz"), &json!("Hz")));
    let graph = model.graph.expect("a graph");
    assert!(graph.input[0].doc_string.contains("stroke_plane_deg [°]"), "{}", graph.input[0].doc_string);
    assert!(graph.output[0].doc_string.starts_with("lift L+ [W]"), "{}", graph.output[0].doc_string);
}
