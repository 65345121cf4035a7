//! Answers, read with care: not everything which answers at a coordinator's address is one.
//! A proxy says 502 or 404 in its own words, a portal asks for a login, an outage leaves
//! half a body. None of that may be taken for what a coordinator decides.

use manduca_protocol::problem::Problem;
use reqwest::header::{CONTENT_TYPE, LOCATION};
use reqwest::{RequestBuilder, Response, StatusCode};
use serde::de::DeserializeOwned;

use super::CallError;

/// Most bytes read of an answer which says no.
const LONGEST_REFUSAL: usize = 4 << 20;
/// Most bytes read of any answer: the training on 200,000 samples, with its checkpoint, has half of it.
const LONGEST_ANSWER: usize = 256 << 20;
/// Characters shown of a stranger's answer.
const SHOWN: usize = 120;

/// Sends a request and gives the answer once its status is a good one.
///
/// # Errors
/// When nothing answers, the coordinator refuses, or something else than a coordinator answers.
pub async fn send(request: RequestBuilder) -> Result<Response, CallError> {
    let response = request.send().await?;
    // No coordinator answers a call with a page for people.
    if response.status().is_success() && media_type(&response) != "text/html" {
        return Ok(response);
    }
    Err(refusal(response).await)
}

/// Sends a request whose answer has no body but a status of its own.
///
/// # Errors
/// As [`send`], and when the status is another one.
pub async fn send_expecting(request: RequestBuilder, status: StatusCode) -> Result<(), CallError> {
    let response = send(request).await?;
    if response.status() == status { Ok(()) } else { Err(refusal(response).await) }
}

/// Sends a request whose answer is streamed in a media type.
///
/// # Errors
/// As [`send`], and when the answer is of another type.
pub async fn open(request: RequestBuilder, expected: &str) -> Result<Response, CallError> {
    let response = send(request).await?;
    if media_type(&response) == expected { Ok(response) } else { Err(refusal(response).await) }
}

/// Sends a request and reads its answer as JSON.
///
/// # Errors
/// As [`send`], and when the answer is not what it should be.
pub async fn call<T: DeserializeOwned>(request: RequestBuilder) -> Result<T, CallError> {
    Ok(call_for_status(request).await?.1)
}

/// [`call`], which also returns the status of the answer.
///
/// # Errors
/// As [`call`].
pub async fn call_for_status<T: DeserializeOwned>(request: RequestBuilder) -> Result<(StatusCode, T), CallError> {
    let response = send(request).await?;
    if !is_json(&response) {
        return Err(refusal(response).await);
    }
    let (url, status) = (response.url().to_string(), response.status());
    let body = whole(response, LONGEST_ANSWER).await?;
    let read = serde_json::from_slice(&body).map_err(|error| CallError::Foreign {
        url,
        status: status.as_u16(),
        what: format!("{status}, but not the JSON expected: {error}"),
    })?;
    Ok((status, read))
}

/// The body of an answer. One which does not end is no coordinator's.
async fn whole(mut response: Response, most: usize) -> Result<Vec<u8>, CallError> {
    let mut body = Vec::new();
    while let Some(part) = response.chunk().await? {
        if body.len() + part.len() > most {
            return Err(CallError::Foreign {
                url: response.url().to_string(),
                status: response.status().as_u16(),
                what: format!("an answer of more than {most} bytes"),
            });
        }
        body.extend_from_slice(&part);
    }
    Ok(body)
}

/// What an answer which is not the one hoped for means.
async fn refusal(response: Response) -> CallError {
    let (url, status, json) = (response.url().to_string(), response.status(), is_json(&response));
    let (of, to) = (media_type(&response), header(&response, LOCATION.as_str()));
    let body = beginning(response).await;
    let problem = if json { serde_json::from_slice::<Problem>(&body).ok() } else { None };
    match problem {
        Some(problem) if problem.is_a_coordinators() && problem.status == status.as_u16() => {
            CallError::Refused(Box::new(problem))
        }
        _ => CallError::Foreign { url, status: status.as_u16(), what: describe(status, &of, &to, &body) },
    }
}

fn describe(status: StatusCode, of: &str, to: &str, body: &[u8]) -> String {
    if status.is_redirection() && !to.is_empty() {
        return format!("{status}, to {}; redirections are not followed, for a token is for one address", plain(to));
    }
    let of = if of.is_empty() { "no media type" } else { of };
    match plain(&String::from_utf8_lossy(body)) {
        text if text.is_empty() => format!("{status}, {}, without a body", plain(of)),
        text => format!("{status}, {}: {text}", plain(of)),
    }
}

/// The beginning of a stranger's text in one line which a terminal can show.
fn plain(text: &str) -> String {
    let words = text.split(|c: char| c.is_whitespace() || c.is_control()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join(" ").chars().take(SHOWN).collect()
}

/// The body, as far as it comes and is not absurdly long.
async fn beginning(mut response: Response) -> Vec<u8> {
    let mut body = Vec::new();
    while let Ok(Some(part)) = response.chunk().await {
        body.extend_from_slice(&part);
        if body.len() > LONGEST_REFUSAL {
            break;
        }
    }
    body
}

fn header(response: &Response, name: &str) -> String {
    response.headers().get(name).and_then(|value| value.to_str().ok()).unwrap_or_default().to_owned()
}

/// The media type without its parameters.
fn media_type(response: &Response) -> String {
    let declared = header(response, CONTENT_TYPE.as_str());
    declared.split(';').next().unwrap_or_default().trim().to_ascii_lowercase()
}

fn is_json(response: &Response) -> bool {
    matches!(media_type(response).as_str(), "application/json" | "application/problem+json")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a call says of an answer.
    async fn told(status: u16, media_type: &str, body: &str) -> CallError {
        let response = http_response(status, media_type, body);
        refusal(response).await
    }

    fn http_response(status: u16, media_type: &str, body: &str) -> Response {
        let response = axum::http::Response::builder().status(status).header(CONTENT_TYPE, media_type);
        Response::from(response.body(body.to_owned()).unwrap())
    }

    fn problem(kind: &str, status: u16) -> String {
        format!(r#"{{"type":"{kind}","title":"t","status":{status},"detail":"d"}}"#)
    }

    #[tokio::test]
    async fn a_problem_is_a_coordinators_by_type_status_and_media_type() {
        let ours = problem("urn:manduca:problem:unknown-worker", 404);
        assert!(told(404, "application/problem+json", &ours).await.is_problem("unknown-worker"));
        assert!(told(404, "application/problem+json; charset=utf-8", &ours).await.is_problem("unknown-worker"));
        for (status, media_type, body) in [
            (404, "text/html", ours.as_str()),
            (502, "application/problem+json", &ours),
            (404, "application/problem+json", &problem("about:blank", 404)),
            (404, "application/problem+json", &problem("https://example.org/unknown-worker", 404)),
            (404, "application/problem+json", &ours[..ours.len() - 3]),
            (404, "application/json", r#"{"error":"not found"}"#),
            (404, "application/json", ""),
            (200, "text/html", "<h1>Log in</h1>"),
        ] {
            let error = told(status, media_type, body).await;
            assert!(
                matches!(error, CallError::Foreign { status: s, .. } if s == status),
                "{media_type} {body}: {error}"
            );
        }
    }

    #[tokio::test]
    async fn an_answer_without_end_is_not_read_to_it() {
        let answer = || http_response(200, "application/json", &" ".repeat(100));
        assert_eq!(whole(answer(), 100).await.unwrap().len(), 100);
        let error = whole(answer(), 99).await.unwrap_err();
        assert!(matches!(&error, CallError::Foreign { what, .. } if what.contains("more than")), "{error}");
    }

    #[tokio::test]
    async fn a_strangers_answer_is_shown_in_one_plain_line() {
        let error = told(502, "text/html", "<h1>\u{1b}[31moh\n\nno</h1>").await.to_string();
        assert!(error.contains("502 Bad Gateway, text/html: <h1> [31moh no</h1>"), "{error}");
        let error = told(404, "", "").await.to_string();
        assert!(error.contains("not from a manduca coordinator") && error.contains("without a body"), "{error}");
    }
}
