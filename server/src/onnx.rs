//! A surrogate of networks as an ONNX model: everything between the ten parameters and L+, D+,
//! M+, P+, in double precision, of operators which every runtime has.
//!
//! `parameters` is a table of strokes, a row each, the columns in the order of the parameter
//! table and in its units; `means` has a row for each with the four scaled means. Names and units
//! travel in the model's metadata.

mod frame;
mod schema;

use std::ops::Range;

use manduca_numerics::parameters::{Bounds, COUNT, OUTPUTS, TABLE, at};
use manduca_numerics::surrogate::{Frame, Network, Surrogate};
use prost::Message;
use serde_json::json;

use schema::{
    AttributeProto, DOUBLE, Dimension, GraphProto, INT, INT64, ModelProto, NodeProto, OperatorSetIdProto,
    StringStringEntryProto, TensorProto, TensorShapeProto, TensorType, TypeProto, ValueInfoProto,
};

/// Set of operators, of 2022: what is used here has not changed since 2020.
const OPSET: i64 = 17;
/// Version of the format which goes with it.
const IR: i64 = 8;

/// A surrogate as an ONNX file, trained within these bounds; none of a gaussian process.
pub(crate) fn model(surrogate: &Surrogate, bounds: &Bounds, name: &str, facts: &[(&str, String)]) -> Option<Vec<u8>> {
    surrogate.members().first()?;
    let mut graph = Graph::default();
    let given = graph.given(surrogate.frame());
    let learnt = graph.networks(surrogate, &given);
    let means = match *surrogate.frame() {
        Frame::Paper => learnt,
        Frame::Physical { reference_hz, arm, .. } => graph.outward(&learnt, reference_hz, arm),
    };
    graph.node("Identity", &[&means], "means", "");
    let input = |(i, p): (usize, &manduca_numerics::parameters::Parameter)| {
        json!({ "name": p.name, "symbol": p.symbol, "unit": p.unit, "meaning": p.meaning,
                "trained_between": [bounds.lower[i], bounds.upper[i]] })
    };
    let output = |(name, _, symbol, scale): &(&str, &str, &str, &str)| json!({ "name": name, "symbol": symbol, "scaled_by": scale });
    let inputs = json!(TABLE.iter().enumerate().map(input).collect::<Vec<_>>()).to_string();
    let outputs = json!(OUTPUTS.iter().map(output).collect::<Vec<_>>()).to_string();
    let columns = |names: Vec<String>| names.join(", ");
    let graph = GraphProto {
        node: graph.nodes,
        name: "surrogate".into(),
        initializer: graph.tensors,
        doc_string: "mean lift, drag, pitching moment and power of hovering strokes".into(),
        input: vec![table(
            "parameters",
            COUNT,
            columns(
                TABLE
                    .iter()
                    .map(|p| format!("{} [{}]", p.name, if p.unit.is_empty() { "1" } else { p.unit }))
                    .collect(),
            ),
        )],
        output: vec![table(
            "means",
            OUTPUTS.len(),
            columns(OUTPUTS.iter().map(|(name, _, symbol, scale)| format!("{name} {symbol} [{scale}]")).collect()),
        )],
    };
    let facts =
        facts.iter().map(|(key, value)| (*key, value.clone())).chain([("inputs", inputs), ("outputs", outputs)]);
    let model = ModelProto {
        ir_version: IR,
        opset_import: vec![OperatorSetIdProto { domain: String::new(), version: OPSET }],
        producer_name: "manduca".into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        doc_string: format!("{name}: L+, D+, M+, P+ of hovering strokes by their ten parameters"),
        graph: Some(graph),
        metadata_props: facts.map(|(key, value)| StringStringEntryProto { key: key.into(), value }).collect(),
    };
    Some(model.encode_to_vec())
}

/// A table of doubles with any number of rows.
fn table(name: &str, columns: usize, doc_string: String) -> ValueInfoProto {
    let dim = vec![
        Dimension { dim_value: None, dim_param: Some("strokes".into()) },
        Dimension { dim_value: Some(columns as i64), dim_param: None },
    ];
    let tensor_type = TensorType { elem_type: DOUBLE, shape: Some(TensorShapeProto { dim }) };
    ValueInfoProto { name: name.into(), r#type: Some(TypeProto { tensor_type: Some(tensor_type) }), doc_string }
}

/// A graph under construction: values have names, and numbers are values.
#[derive(Default)]
struct Graph {
    nodes: Vec<NodeProto>,
    tensors: Vec<TensorProto>,
}

impl Graph {
    /// Adds numbers under a name.
    fn numbers(&mut self, name: &str, dims: &[usize], values: &[f64]) -> String {
        let raw_data = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let dims = dims.iter().map(|&n| n as i64).collect();
        self.tensors.push(TensorProto {
            dims,
            data_type: DOUBLE,
            name: name.into(),
            raw_data,
            doc_string: String::new(),
        });
        name.to_owned()
    }

    /// Adds one number.
    fn number(&mut self, name: &str, value: f64) -> String {
        self.numbers(name, &[], &[value])
    }

    /// Adds an operator whose value has the name `output`.
    fn node(&mut self, op: &str, inputs: &[&str], output: &str, doc: &str) -> String {
        self.nodes.push(NodeProto {
            input: inputs.iter().map(|&i| i.to_owned()).collect(),
            output: vec![output.into()],
            name: output.into(),
            op_type: op.into(),
            attribute: Vec::new(),
            doc_string: doc.into(),
        });
        output.to_owned()
    }

    /// Adds an operator along the columns of tables.
    fn node_by_columns(&mut self, op: &str, inputs: &[&str], output: &str) -> String {
        let name = self.node(op, inputs, output, "");
        if let Some(node) = self.nodes.last_mut() {
            node.attribute.push(AttributeProto { name: "axis".into(), i: 1, r#type: INT });
        }
        name
    }

    /// One column of a table, as a table.
    fn column(&mut self, table: &str, index: usize, output: &str) -> String {
        self.columns(table, index..index + 1, output)
    }

    /// Some columns of a table, as a table.
    fn columns(&mut self, table: &str, indices: Range<usize>, output: &str) -> String {
        let name = format!("{output}.columns");
        let dims = vec![indices.len() as i64];
        let raw_data = indices.flat_map(|i| (i as i64).to_le_bytes()).collect();
        let doc_string = String::new();
        self.tensors.push(TensorProto { dims, data_type: INT64, name: name.clone(), raw_data, doc_string });
        self.node_by_columns("Gather", &[table, &name], output)
    }

    /// The mean of all networks, and where the mirror law holds of their mirror images.
    fn networks(&mut self, surrogate: &Surrogate, given: &str) -> String {
        let members = surrogate.members();
        let inputs = self.scaled(&members[0], given);
        let mut images = vec![("", inputs.clone(), None)];
        if surrogate.frame().is_mirrored() {
            let signs: [f64; COUNT] =
                std::array::from_fn(|i| if i == at::SWEEP_MEAN || i == at::ROTATION_MEAN { -1.0 } else { 1.0 });
            let signs = self.numbers("mirror.inputs", &[COUNT], &signs);
            let mirrored = self.node("Mul", &[&inputs, &signs], "inputs.mirrored", "phi0 and alpha0 reversed");
            let signs = self.numbers("mirror.outputs", &[4], &[1.0, -1.0, -1.0, 1.0]);
            images.push((".mirrored", mirrored, Some(signs)));
        }
        let mut sum: Option<String> = None;
        for (m, member) in members.iter().enumerate() {
            self.weights(m, member);
            for (image, inputs, signs) in &images {
                let at = format!("network{m}{image}");
                let mut value = self.network(m, inputs, &at);
                if let Some(signs) = signs {
                    value = self.node("Mul", &[&value, signs], &format!("{at}.back"), "T and M_h change sign");
                }
                sum = Some(match sum {
                    Some(before) => self.node("Add", &[&before, &value], &format!("{at}.sum"), ""),
                    None => value,
                });
            }
        }
        let share = self.number("share", 1.0 / (members.len() * images.len()) as f64);
        self.node("Mul", &[&sum.unwrap_or_default(), &share], "learnt", "the mean of all networks")
    }

    /// The inputs of networks: what they are given, from its bounds to -1 to 1, 0 where held.
    fn scaled(&mut self, network: &Network, given: &str) -> String {
        let bounds = &network.bounds;
        let held = |i: usize| bounds.upper[i] <= bounds.lower[i];
        let factors: [f64; COUNT] =
            std::array::from_fn(|i| if held(i) { 0.0 } else { 2.0 / (bounds.upper[i] - bounds.lower[i]) });
        let shifts: [f64; COUNT] = std::array::from_fn(|i| if held(i) { 0.0 } else { 1.0 });
        let lower = self.numbers("bounds.lower", &[COUNT], &bounds.lower);
        let factors = self.numbers("bounds.factors", &[COUNT], &factors);
        let shifts = self.numbers("bounds.shifts", &[COUNT], &shifts);
        let above = self.node("Sub", &[given, &lower], "given.above", "");
        let wide = self.node("Mul", &[&above, &factors], "given.scaled", "");
        self.node("Sub", &[&wide, &shifts], "inputs", "from bounds to [-1, 1]")
    }

    fn weights(&mut self, m: usize, network: &Network) {
        let h = network.neurons();
        let turned = |values: &[f64], rows: usize, columns: usize| -> Vec<f64> {
            (0..columns).flat_map(|c| (0..rows).map(move |r| (r, c))).map(|(r, c)| values[r * columns + c]).collect()
        };
        self.numbers(&format!("network{m}.hidden.weights"), &[COUNT, h], &turned(&network.hidden_weights, h, COUNT));
        self.numbers(&format!("network{m}.hidden.biases"), &[h], &network.hidden_biases);
        self.numbers(&format!("network{m}.output.weights"), &[h, 4], &turned(&network.output_weights, 4, h));
        self.numbers(&format!("network{m}.output.biases"), &[4], &network.output_biases);
    }

    fn network(&mut self, m: usize, inputs: &str, at: &str) -> String {
        let of = |part: &str| format!("network{m}.{part}");
        let sums = self.node("MatMul", &[inputs, &of("hidden.weights")], &format!("{at}.sums"), "");
        let sums = self.node("Add", &[&sums, &of("hidden.biases")], &format!("{at}.biased"), "");
        let active = self.node("Tanh", &[&sums], &format!("{at}.hidden"), "");
        let out = self.node("MatMul", &[&active, &of("output.weights")], &format!("{at}.weighted"), "");
        self.node("Add", &[&out, &of("output.biases")], &format!("{at}.out"), "")
    }
}

#[cfg(test)]
#[path = "onnx/tests.rs"]
mod tests;
