// The enveloped signature of the XML.
#include "reports/signing_key.h"
#include "reports/xml_document.h"

#include "core/error.h"
#include "reports/html.h"

#include <fmt/format.h>
#include <libxml/parser.h>
#include <libxml/tree.h>
#include <openssl/evp.h>
#include <openssl/x509.h>
// Before the others of its library, which use its types.
#include <xmlsec/xmlsec.h>

#include <xmlsec/errors.h>
#include <xmlsec/keyinfo.h>
#include <xmlsec/keysmngr.h>
#include <xmlsec/openssl/app.h>
#include <xmlsec/openssl/crypto.h>
#include <xmlsec/openssl/evp.h>
#include <xmlsec/openssl/x509.h>
#include <xmlsec/templates.h>
#include <xmlsec/xmldsig.h>
#include <xmlsec/xmltree.h>

#include <memory>

namespace fringecal::reports {
namespace {

struct Free {
  void operator()(xmlSecDSigCtxPtr x) const { xmlSecDSigCtxDestroy(x); }
  void operator()(xmlSecKeysMngrPtr x) const { xmlSecKeysMngrDestroy(x); }
  void operator()(xmlSecKeyPtr x) const { xmlSecKeyDestroy(x); }
};
using Context = std::unique_ptr<xmlSecDSigCtx, Free>;
using Manager = std::unique_ptr<xmlSecKeysMngr, Free>;

void silent(const char*, int, const char*, const char*, const char*, int, const char*) {}

/// xmlsec is started at its first use: --help of the program does not pay for it.
void start() {
  static const bool started = [] {
    const bool all = xmlSecInit() == 0 && xmlSecOpenSSLAppInit(nullptr) == 0 && xmlSecOpenSSLInit() == 0;
    xmlSecErrorsSetCallback(&silent);  // after the start, which sets its own
    return all;
  }();
  if (!started) throw EnvironmentError("the XML signature library does not start; reinstall libxmlsec1-openssl");
}

void must(bool done, const char* what) {
  if (!done) throw InputError(fmt::format("the certificate cannot be signed: {}", what));
}

xmlSecKeyPtr key_for_xmlsec(const SigningKey::State& state) {
  EVP_PKEY_up_ref(state.key.get());
  xmlSecKeyDataPtr data = xmlSecOpenSSLEvpKeyAdopt(state.key.get());
  must(data != nullptr, "its key is not one that XMLDSig knows");
  std::unique_ptr<xmlSecKey, Free> key(xmlSecKeyCreate());
  must(key != nullptr && xmlSecKeySetValue(key.get(), data) == 0, "its key cannot be used");
  for (const auto& certificate : state.certificates) {
    const std::string pem = pem_of(certificate.get());
    must(xmlSecOpenSSLAppKeyCertLoadMemory(key.get(), reinterpret_cast<const xmlSecByte*>(pem.data()),
                                           static_cast<xmlSecSize>(pem.size()), xmlSecKeyDataFormatPem) == 0,
         "its X.509 certificate cannot be used");
  }
  return key.release();
}

std::string text_of(xmlDocPtr document) {
  xmlChar* bytes = nullptr;
  int size = 0;
  xmlDocDumpMemoryEnc(document, &bytes, &size, "UTF-8");
  std::string out(reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(size));
  xmlFree(bytes);
  return out;
}

/// Only what sign_xml() writes, and its close relatives, may be in a signature.
void restrict(xmlSecDSigCtxPtr context) {
  const auto reference = [&](xmlSecTransformId id) {
    must(xmlSecDSigCtxEnableReferenceTransform(context, id) == 0, "setup");
  };
  const auto signature = [&](xmlSecTransformId id) {
    must(xmlSecDSigCtxEnableSignatureTransform(context, id) == 0, "setup");
  };
  for (const auto id : {xmlSecTransformInclC14NId, xmlSecTransformInclC14N11Id, xmlSecTransformExclC14NId}) {
    reference(id);
    signature(id);
  }
  reference(xmlSecTransformEnvelopedId);
  for (const auto id : {xmlSecOpenSSLTransformSha256Id, xmlSecOpenSSLTransformSha384Id, xmlSecOpenSSLTransformSha512Id})
    reference(id);
  for (const auto id : {xmlSecOpenSSLTransformRsaSha256Id, xmlSecOpenSSLTransformRsaSha384Id,
                        xmlSecOpenSSLTransformRsaSha512Id, xmlSecOpenSSLTransformEcdsaSha256Id,
                        xmlSecOpenSSLTransformEcdsaSha384Id, xmlSecOpenSSLTransformEcdsaSha512Id}) {
    signature(id);
  }
  context->enabledReferenceUris = xmlSecTransformUriTypeEmpty;
  xmlSecPtrListAdd(&context->keyInfoReadCtx.enabledKeyData,
                   const_cast<xmlSecPtr>(static_cast<const void*>(xmlSecOpenSSLKeyDataX509Id)));
}

/// The fault of one Signature, or "".
std::string fault_of(xmlNodePtr signature, xmlSecKeysMngrPtr manager, bool trust_asked, std::string& subject) {
  const Context context(xmlSecDSigCtxCreate(manager));
  restrict(context.get());
  if (!trust_asked) context->keyInfoReadCtx.flags |= XMLSEC_KEYINFO_FLAGS_X509DATA_DONT_VERIFY_CERTS;
  const int status = xmlSecDSigCtxVerify(context.get(), signature);
  if (context->signKey != nullptr) {
    xmlSecKeyDataPtr data = xmlSecKeyGetData(context->signKey, xmlSecOpenSSLKeyDataX509Id);
    X509* certificate = data == nullptr ? nullptr : xmlSecOpenSSLKeyDataX509GetKeyCert(data);
    if (certificate != nullptr) subject = subject_of(certificate);
  }
  if (status == 0 && context->status == xmlSecDSigStatusSucceeded &&
      xmlSecPtrListGetSize(&context->signedInfoReferences) == 1) {
    return "";
  }
  if (context->signKey == nullptr) {
    return trust_asked ? "its signer's certificate does not lead to one of the trusted certificates"
                       : "its signature holds no certificate that can be used";
  }
  for (xmlSecSize k = 0; k < xmlSecPtrListGetSize(&context->signedInfoReferences); ++k) {
    const auto* reference =
        static_cast<xmlSecDSigReferenceCtxPtr>(xmlSecPtrListGetItem(&context->signedInfoReferences, k));
    if (reference->status == xmlSecDSigStatusInvalid)
      return "its signature does not hold: the content was altered after it was signed";
  }
  return "its signature does not hold: the signature itself was altered, or is of a kind that is not accepted";
}

}  // namespace

std::string sign_xml(const std::string& xml, const SigningKey& key) {
  start();
  const XmlDocument document = XmlDocument::parse(xml, "the certificate");
  xmlNodePtr root = xmlDocGetRootElement(document.raw());
  const auto& state = key.state();
  xmlNodePtr signature = xmlSecTmplSignatureCreate(
      document.raw(), xmlSecTransformInclC14N11Id,
      state.is_ec ? xmlSecOpenSSLTransformEcdsaSha256Id : xmlSecOpenSSLTransformRsaSha256Id, nullptr);
  must(signature != nullptr, "no template");
  xmlAddChild(root, signature);
  xmlNodePtr reference = xmlSecTmplSignatureAddReference(signature, xmlSecOpenSSLTransformSha256Id, nullptr,
                                                         reinterpret_cast<const xmlChar*>(""), nullptr);
  must(reference != nullptr && xmlSecTmplReferenceAddTransform(reference, xmlSecTransformEnvelopedId) != nullptr &&
           xmlSecTmplReferenceAddTransform(reference, xmlSecTransformInclC14N11Id) != nullptr,
       "no reference");
  xmlNodePtr info = xmlSecTmplSignatureEnsureKeyInfo(signature, nullptr);
  must(info != nullptr && xmlSecTmplKeyInfoAddX509Data(info) != nullptr, "no key information");
  const Context context(xmlSecDSigCtxCreate(nullptr));
  context->flags |= XMLSEC_DSIG_FLAGS_STORE_SIGNATURE;
  context->signKey = key_for_xmlsec(state);
  must(xmlSecDSigCtxSign(context.get(), signature) == 0, "its key does not sign");
  if (state.is_ec) {  // the same value again with the nonce of RFC 6979
    const xmlSecBufferPtr signed_info = xmlSecDSigCtxGetPreSignBuffer(context.get());
    must(signed_info != nullptr, "no SignedInfo");
    const std::string value = ecdsa_sha256(state, {reinterpret_cast<const char*>(xmlSecBufferGetData(signed_info)),
                                                   static_cast<std::size_t>(xmlSecBufferGetSize(signed_info))});
    xmlNodePtr node = xmlSecFindChild(signature, xmlSecNodeSignatureValue, xmlSecDSigNs);
    must(node != nullptr, "no SignatureValue");
    xmlNodeSetContent(node, reinterpret_cast<const xmlChar*>(base64(value).c_str()));
  }
  return text_of(document.raw());
}

SignatureVerdict verify_xml(const std::string& xml, const std::vector<std::filesystem::path>& trusted) {
  start();
  const XmlDocument document = XmlDocument::parse(xml, "the certificate");
  const Manager manager(xmlSecKeysMngrCreate());
  require(manager != nullptr && xmlSecOpenSSLAppDefaultKeysMngrInit(manager.get()) == 0, "there is memory for keys");
  for (const auto& file : trusted) {
    for (const auto& one : certificates_of(file)) {
      const std::string pem = pem_of(one.get());
      xmlSecOpenSSLAppKeysMngrCertLoadMemory(manager.get(), reinterpret_cast<const xmlSecByte*>(pem.data()),
                                             static_cast<xmlSecSize>(pem.size()), xmlSecKeyDataFormatPem,
                                             xmlSecKeyDataTypeTrusted);
    }
  }
  SignatureVerdict out;
  for (xmlNodePtr node = xmlDocGetRootElement(document.raw())->children; node != nullptr; node = node->next) {
    if (!xmlSecCheckNodeName(node, xmlSecNodeSignature, xmlSecDSigNs)) continue;
    out.present = true;
    if (out.fault.empty()) out.fault = fault_of(node, manager.get(), !trusted.empty(), out.subject);
  }
  return out;
}

}  // namespace fringecal::reports
