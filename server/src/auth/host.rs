//! Names of a server, as `Host`, `Origin` and request targets spell them.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::str::FromStr;

/// A host without its port: a name in lower case and without the root's dot, or an IP address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Host {
    /// A name.
    Name(String),
    /// An address.
    Address(IpAddr),
}

impl Host {
    /// Whether it is this machine and no other, whatever a name server says.
    fn is_loopback(&self) -> bool {
        match self {
            Self::Name(name) => name == "localhost",
            Self::Address(address) => address.is_loopback(),
        }
    }
}

impl fmt::Display for Host {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name(name) => f.write_str(name),
            Self::Address(address) => write!(f, "{address}"),
        }
    }
}

impl FromStr for Host {
    type Err = String;

    /// Reads a host without a port. An IPv6 address may stand in brackets or without.
    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(address) = text.parse::<Ipv6Addr>() {
            return Ok(Self::Address(address.into()));
        }
        match Authority::parse(text) {
            Some(Authority { host, port: None }) if !text.ends_with(':') => Ok(host),
            Some(_) => Err("is to be a name or an address without a port: every port is taken".into()),
            None => Err("is neither the name of a host nor an IP address".into()),
        }
    }
}

/// A host with its port, where one is given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Authority {
    pub(super) host: Host,
    pub(super) port: Option<u16>,
}

impl Authority {
    /// Reads `host[:port]` (RFC 9110, 7.2). User information, spaces and zones are no part of it.
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (host, port) = match text.strip_prefix('[') {
            Some(rest) => {
                let (address, after) = rest.split_once(']')?;
                let port = if after.is_empty() { None } else { Some(after.strip_prefix(':')?) };
                (Host::Address(address.parse::<Ipv6Addr>().ok()?.into()), port)
            }
            None => {
                let (host, port) = text.split_once(':').map_or((text, None), |(host, port)| (host, Some(port)));
                (name_or_address(host)?, port)
            }
        };
        let port = match port {
            None | Some("") => None,
            Some(digits) if digits.bytes().all(|b| b.is_ascii_digit()) => Some(digits.parse().ok()?),
            Some(_) => return None,
        };
        Some(Self { host, port })
    }

    /// Reads the origin of a page served over HTTP (RFC 6454, 6.2), its port filled in.
    pub(super) fn of_origin(text: &str) -> Option<Self> {
        let (rest, default) =
            text.strip_prefix("http://").map(|rest| (rest, 80)).or(text.strip_prefix("https://").map(|r| (r, 443)))?;
        Self::parse(rest).map(|authority| authority.or_port(default))
    }

    /// The same with this port where none is given.
    pub(super) fn or_port(self, default: u16) -> Self {
        Self { port: self.port.or(Some(default)), ..self }
    }
}

fn name_or_address(text: &str) -> Option<Host> {
    if let Ok(address) = text.parse::<Ipv4Addr>() {
        return Some(Host::Address(address.into()));
    }
    let name = text.strip_suffix('.').unwrap_or(text);
    let is_label =
        |label: &str| !label.is_empty() && label.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_');
    name.split('.').all(is_label).then(|| Host::Name(name.to_ascii_lowercase()))
}

/// The hosts under which a coordinator that asks for no tokens answers. Loopback is always among them.
///
/// A page of another site can give its own name the coordinator's address (DNS rebinding), and then passes for the
/// coordinator's own page. It cannot do so with a name that it does not own, nor with an address.
#[derive(Debug, Clone, Default)]
pub struct Hosts {
    allowed: Vec<Host>,
    addresses: bool,
}

impl Hosts {
    /// Loopback and the hosts given.
    pub fn new(allowed: impl IntoIterator<Item = Host>) -> Self {
        Self { allowed: allowed.into_iter().collect(), addresses: false }
    }

    /// The same with every IP address, for a coordinator that others reach by one.
    #[must_use]
    pub fn with_addresses(self) -> Self {
        Self { addresses: true, ..self }
    }

    /// Whether the coordinator answers under this host.
    pub(super) fn include(&self, host: &Host) -> bool {
        let is_address = matches!(host, Host::Address(_));
        host.is_loopback() || (is_address && self.addresses) || self.allowed.contains(host)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_is_known_in_every_spelling_and_nothing_else_is() {
        let hosts = Hosts::default();
        let includes = |text: &str| Authority::parse(text).is_some_and(|authority| hosts.include(&authority.host));
        for own in [
            "localhost",
            "LocalHost:8080",
            "localhost.",
            "localhost.:1",
            "localhost:",
            "127.0.0.1",
            "127.0.0.1:65535",
            "127.255.3.4:80",
            "[::1]",
            "[::1]:8080",
            "[0:0:0:0:0:0:0:1]:9",
        ] {
            assert!(includes(own), "{own}");
        }
        for foreign in [
            "",
            ":8080",
            ".",
            "evil.example",
            "evil.example:8080",
            "evil.example.",
            "localhost.evil.example",
            "localhost..",
            "x.localhost",
            "127.0.0.1.evil.example",
            "127.0.0.1.",
            "127.0.0.1.nip.io",
            "127.1",
            "0177.0.0.1",
            "2130706433",
            "0x7f000001",
            "0.0.0.0",
            "[::]",
            "[::ffff:127.0.0.1]",
            "[::1",
            "::1",
            "[::1]x",
            "[::1%25lo]",
            "[::1%lo]",
            "[localhost]",
            "128.0.0.1",
            "localhost:80:80",
            "localhost:8o",
            "localhost:-1",
            "localhost:+80",
            "localhost:65536",
            "me@localhost",
            "me@localhost:80",
            "localhost:80@evil.example",
            "localhost, evil.example",
            "localhost evil.example",
            "localhost/",
            "http://localhost",
            "localhost#",
            "localhost\\",
            "LOCALHOST\t",
            "\u{212A}ocalhost",
            "*",
        ] {
            assert!(!includes(foreign), "{foreign}");
        }
    }

    #[test]
    fn hosts_are_added_by_name_and_by_address() {
        let host = |text: &str| text.parse::<Host>().expect(text);
        let hosts = Hosts::new([host("Manduca.Example."), host("::2"), host("[::3]"), host("10.0.0.5")]);
        let includes = |hosts: &Hosts, text: &str| hosts.include(&Authority::parse(text).expect(text).host);
        for own in ["manduca.example:9000", "MANDUCA.example.", "[::2]:1", "[0::3]", "10.0.0.5", "localhost"] {
            assert!(includes(&hosts, own), "{own}");
        }
        assert!(!includes(&hosts, "10.0.0.6") && !includes(&hosts, "a.manduca.example"));
        let any = hosts.with_addresses();
        assert!(includes(&any, "10.0.0.6:8080") && includes(&any, "[fe80::1]") && !includes(&any, "evil.example"));
        for bad in
            ["", "a:80", "a:", "[::1]:80", "10.0.0.1:80", "http://a", "a/b", "a b", "*", "*.example", "ü.example"]
        {
            assert!(bad.parse::<Host>().is_err(), "{bad}");
        }
    }

    #[test]
    fn origins_have_a_port() {
        let of = |text: &str| Authority::of_origin(text).and_then(|a| a.port);
        assert_eq!([of("http://a"), of("https://a"), of("http://a:8080")], [Some(80), Some(443), Some(8080)]);
        for bad in
            ["null", "", "a", "ftp://a", "file://", "http://", "http://a/", "http://u@a", "HTTP://a", "about:blank"]
        {
            assert_eq!(of(bad), None, "{bad}");
        }
    }
}
