//! Changes of a JSON document.

use proptest::prelude::*;
use proptest::sample::Index;
use serde_json::{Map, Value, json};

/// Longest a worker may say it waits here, s: nobody would end the wait.
const NO_WAIT: &str = "wait_s";

/// One change, at a place chosen among all there are.
#[derive(Debug, Clone)]
pub(super) enum Change {
    /// Another value there.
    Replace(Index, Value),
    /// A member or an element less.
    Remove(Index, Index),
    /// A member or an element more.
    Insert(Index, String, Value),
    /// A member or an element twice.
    Repeat(Index, Index),
}

/// Several changes, or none.
pub(super) fn changes() -> impl Strategy<Value = Vec<Change>> {
    let at = any::<Index>;
    let change = prop_oneof![
        4 => (at(), value()).prop_map(|(at, value)| Change::Replace(at, value)),
        2 => (at(), at()).prop_map(|(at, which)| Change::Remove(at, which)),
        1 => (at(), text(), value()).prop_map(|(at, name, value)| Change::Insert(at, name, value)),
        1 => (at(), at()).prop_map(|(at, which)| Change::Repeat(at, which)),
    ];
    prop::collection::vec(change, 0..4)
}

fn text() -> impl Strategy<Value = String> {
    prop_oneof![
        "[a-z_]{0,12}",
        "\\PC{0,20}",
        Just("\0".to_owned()),
        Just("'; drop table jobs; --".to_owned()),
        Just("../../etc/passwd".to_owned()),
        Just("x".repeat(100_000)),
        prop::sample::select(vec!["seed", "name", "kind", "uvlm", "quasi-steady", "direct", "simulate", "train"])
            .prop_map(str::to_owned),
    ]
}

fn value() -> impl Strategy<Value = Value> {
    let edges = [
        json!(null),
        json!(true),
        json!(0),
        json!(-0.0),
        json!(-1),
        json!(1),
        json!(2),
        json!(255),
        json!(0.5),
        json!(1e-308),
        json!(1e308),
        json!(-1e308),
        json!(i64::MIN),
        json!(i64::MAX),
        json!(u64::MAX),
        json!(u32::MAX),
        json!(i32::MIN),
        json!([]),
        json!({}),
    ];
    let leaf = prop_oneof![
        4 => prop::sample::select(edges.to_vec()),
        1 => any::<f64>().prop_map(|x| json!(x)),
        1 => (-400_i64..400).prop_map(|n| json!(n)),
        2 => text().prop_map(Value::String),
    ];
    leaf.prop_recursive(4, 24, 6, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..6).prop_map(Value::Array),
            prop::collection::vec((text(), inner), 0..4).prop_map(|all| Value::Object(Map::from_iter(all))),
        ]
    })
}

/// The text of a changed document, some of its bytes replaced.
pub(super) fn mutated(fine: &Value, changes: &[Change], bytes: &[(Index, u8)]) -> String {
    let mut document = fine.clone();
    for change in changes {
        match change {
            Change::Replace(at, value) => *chosen(&mut document, at) = value.clone(),
            Change::Remove(at, which) => remove(chosen(&mut document, at), which),
            Change::Insert(at, name, value) => insert(chosen(&mut document, at), name, value),
            Change::Repeat(at, which) => repeat(chosen(&mut document, at), which),
        }
    }
    if document[NO_WAIT].as_f64().is_some_and(|wait| wait > 0.0 && wait < 1000.0) {
        document[NO_WAIT] = json!(0);
    }
    let mut text = document.to_string().into_bytes();
    for (at, byte) in bytes {
        let at = at.index(text.len());
        text[at] = *byte;
    }
    String::from_utf8_lossy(&text).into_owned()
}

/// One of all values of a document, itself among them.
fn chosen<'v>(document: &'v mut Value, at: &Index) -> &'v mut Value {
    let nth = at.index(count(document));
    find(document, nth)
}

fn count(value: &Value) -> usize {
    1 + match value {
        Value::Array(all) => all.iter().map(count).sum(),
        Value::Object(all) => all.values().map(count).sum(),
        _ => 0,
    }
}

/// The value whose number is `nth` when each comes before its parts.
fn find(value: &mut Value, nth: usize) -> &mut Value {
    if nth == 0 {
        return value;
    }
    let mut left = nth - 1;
    let parts: Vec<&mut Value> = match value {
        Value::Array(all) => all.iter_mut().collect(),
        Value::Object(all) => all.values_mut().collect(),
        _ => Vec::new(),
    };
    for part in parts {
        let size = count(part);
        if left < size {
            return find(part, left);
        }
        left -= size;
    }
    unreachable!("a number below the count")
}

fn remove(value: &mut Value, which: &Index) {
    match value {
        Value::Array(all) if !all.is_empty() => drop(all.remove(which.index(all.len()))),
        Value::Object(all) if !all.is_empty() => {
            let name = all.keys().nth(which.index(all.len())).cloned();
            name.and_then(|name| all.remove(&name));
        }
        other => *other = Value::Null,
    }
}

fn insert(value: &mut Value, name: &str, new: &Value) {
    match value {
        Value::Array(all) => all.push(new.clone()),
        Value::Object(all) => drop(all.insert(name.to_owned(), new.clone())),
        other => *other = new.clone(),
    }
}

fn repeat(value: &mut Value, which: &Index) {
    if let Value::Array(all) = value
        && !all.is_empty()
    {
        let twin = all[which.index(all.len())].clone();
        all.push(twin);
    }
}
