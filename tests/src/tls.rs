//! A reverse proxy which speaks TLS to the world and HTTP to a coordinator, as an operator sets
//! one up before it.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use rcgen::{CertificateParams, KeyPair, date_time_ymd};
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::PrivateKeyDer;

/// A proxy on a port of its own, with a certificate for `localhost` which nobody else has signed.
#[derive(Debug)]
pub struct TlsProxy {
    address: SocketAddr,
    certificate: String,
    // Its tasks end with it.
    _runtime: Runtime,
}

impl TlsProxy {
    /// Before the coordinator at `upstream`, a `host:port`.
    ///
    /// # Panics
    /// Where no certificate can be made or no port be had.
    pub fn before(upstream: &str) -> Self {
        Self::with(upstream, |_| {})
    }

    /// [`TlsProxy::before`] with a certificate which has expired.
    ///
    /// # Panics
    /// As [`TlsProxy::before`].
    pub fn expired_before(upstream: &str) -> Self {
        Self::with(upstream, |certificate| certificate.not_after = date_time_ymd(2020, 1, 1))
    }

    fn with(upstream: &str, change: impl FnOnce(&mut CertificateParams)) -> Self {
        let mut parameters = CertificateParams::new(["localhost".to_owned()]).expect("a name");
        change(&mut parameters);
        let signing_key = KeyPair::generate().expect("a key");
        let cert = parameters.self_signed(&signing_key).expect("a certificate");
        let key = PrivateKeyDer::try_from(signing_key.serialize_der()).expect("a key");
        let config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .and_then(|builder| builder.with_no_client_auth().with_single_cert(vec![cert.der().clone()], key))
            .expect("settings which fit each other");
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.expect("a runtime");
        let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0")).expect("a port");
        let address = listener.local_addr().expect("an address");
        runtime.spawn(serve(listener, TlsAcceptor::from(Arc::new(config)), upstream.to_owned()));
        Self { address, certificate: cert.pem(), _runtime: runtime }
    }

    /// Its address as workers and clients are given it.
    pub fn url(&self) -> String {
        format!("https://localhost:{}", self.address.port())
    }

    /// Writes its certificate, for those who are to trust it.
    ///
    /// # Panics
    /// Where the file cannot be written.
    pub fn write_certificate(&self, file: PathBuf) -> PathBuf {
        std::fs::write(&file, &self.certificate).expect("a certificate file");
        file
    }
}

async fn serve(listener: TcpListener, acceptor: TlsAcceptor, upstream: String) {
    while let Ok((stream, _)) = listener.accept().await {
        let (acceptor, upstream) = (acceptor.clone(), upstream.clone());
        tokio::spawn(async move {
            // A client which does not trust the certificate hangs up here.
            let mut outside = acceptor.accept(stream).await?;
            let mut inside = TcpStream::connect(&upstream).await?;
            copy_bidirectional(&mut outside, &mut inside).await
        });
    }
}
