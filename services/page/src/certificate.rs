//! The certificate for HTTPS, made at the first start and kept: its fingerprint is how a person recognizes the robot.

use command::{Answer, Failure};
use rcgen::{CertificateParams, DnType, KeyPair};
use rustls::ServerConfig;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use sha2::{Digest, Sha256};
use std::path::Path;
use std::sync::Arc;

/// A certificate with its key.
pub(crate) struct Certificate {
    pub(crate) config: Arc<ServerConfig>,
    /// SHA-256 of the certificate, as browsers show it.
    pub(crate) fingerprint: String,
}

/// Reads the certificate of a folder; makes it with these names if there is none.
///
/// # Errors
/// The folder cannot be written, or its files are no certificate.
pub(crate) fn certificate(folder: &Path, names: &[String]) -> Answer<Certificate> {
    let (chain, key) = (folder.join("page-certificate.pem"), folder.join("page-key.pem"));
    let failed = |path: &Path, why: &dyn std::fmt::Display| {
        Failure::NotNow(format!("{} cannot be used: {why}; remove it, and a new one is made", path.display()))
    };
    if !chain.exists() || !key.exists() {
        let made = made(names).map_err(Failure::not_now)?;
        std::fs::create_dir_all(folder).map_err(|error| failed(folder, &error))?;
        // The mask of this program keeps both to its user.
        std::fs::write(&key, made.1).map_err(|error| failed(&key, &error))?;
        std::fs::write(&chain, made.0).map_err(|error| failed(&chain, &error))?;
    }
    let certificate = CertificateDer::from_pem_file(&chain).map_err(|error| failed(&chain, &error))?;
    let secret = PrivateKeyDer::from_pem_file(&key).map_err(|error| failed(&key, &error))?;
    let digest = Sha256::digest(&certificate);
    let fingerprint = digest.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(":");
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .map_err(Failure::not_now)?
        .with_no_client_auth()
        .with_single_cert(vec![certificate], secret)
        .map_err(|error| failed(&chain, &error))?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(Certificate { config: Arc::new(config), fingerprint })
}

fn made(names: &[String]) -> Result<(String, String), rcgen::Error> {
    let key = KeyPair::generate()?;
    let mut parameters = CertificateParams::new(names.to_vec())?;
    parameters.distinguished_name.push(DnType::CommonName, "nims robot");
    let certificate = parameters.self_signed(&key)?;
    Ok((certificate.pem(), key.serialize_pem()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_certificate_is_made_once() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["localhost".to_owned(), "10.0.0.1".to_owned()];
        let first = certificate(folder.path(), &names).unwrap().fingerprint;
        assert_eq!(first.len(), 32 * 3 - 1);
        assert_eq!(certificate(folder.path(), &[]).unwrap().fingerprint, first);
        std::fs::write(folder.path().join("page-key.pem"), "nothing").unwrap();
        let refused = certificate(folder.path(), &names).map(|_| ()).unwrap_err().to_string();
        assert!(refused.contains("page-key.pem"), "{refused}");
    }
}
