// fringecal certify RECORD... --lab lab.toml --customer customer.toml --number N: a calibration certificate as a folder.
#include "cli/commands.h"
#include "cli/records.h"
#include "core/error.h"
#include "core/file.h"
#include "metrology/history.h"
#include "reports/archival_pdf.h"
#include "reports/certificate_data.h"
#include "reports/certificate_dcc.h"
#include "reports/certificate_html.h"
#include "reports/signature.h"
#include "reports/time_stamp.h"
#include "reports/xml_document.h"

#include <fmt/format.h>
#include <unistd.h>
#include <CLI/CLI.hpp>

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::cli {
namespace {

constexpr const char* kPassphraseVariable = "FRINGECAL_PASSPHRASE";

struct CertifyArguments {
  std::vector<std::string> records, as_found;
  std::string history, clouds, lab, customer, number, language = "en", output;
  std::string key, certificate, passphrase_file, schema_dir, time_stamp;
  bool json = false;
};

std::string first_line(const std::string& text) { return text.substr(0, text.find_first_of("\r\n")); }

/// From the file, from the environment, or asked for at the terminal; never from the command line, which others can see.
std::string passphrase(const CertifyArguments& arguments) {
  if (!arguments.passphrase_file.empty()) return first_line(read_bytes(arguments.passphrase_file));
  if (const char* words = std::getenv(kPassphraseVariable)) return words;
  if (::isatty(STDIN_FILENO) == 0) {
    throw InputError(fmt::format("{} is encrypted; give its passphrase with --passphrase-file or in {}", arguments.key,
                                 kPassphraseVariable));
  }
  const std::unique_ptr<char, decltype(&std::free)> words(::strdup(::getpass("Passphrase of the key: ")), &std::free);
  return words ? words.get() : "";
}

std::optional<reports::SigningKey> key_of(const CertifyArguments& arguments) {
  if (arguments.key.empty()) return std::nullopt;
  std::optional<std::filesystem::path> certificate;
  if (!arguments.certificate.empty()) certificate = arguments.certificate;
  return reports::SigningKey::load(arguments.key, certificate, [&] { return passphrase(arguments); });
}

reports::Certificate certificate_of(const CertifyArguments& arguments) {
  reports::Certificate c;
  c.number = arguments.number;
  c.language = arguments.language;
  c.issued = utc_now();
  c.laboratory = reports::read_laboratory(arguments.lab);
  c.customer = reports::read_customer(arguments.customer);
  c.records = read_records(arguments.as_found, arguments.history);
  for (auto& record : c.records) record.as_found = true;
  for (auto& record : read_records(arguments.records, arguments.history)) c.records.push_back(std::move(record));
  if (!arguments.history.empty())
    c.past = read_past(arguments.history, c.records.back().verification.scanner, c.issued);
  if (!arguments.clouds.empty()) {
    take_clouds(c.records, arguments.clouds);
  } else if (arguments.history.empty()) {
    take_clouds_beside(c.records, arguments.as_found, arguments.records);
  }
  reports::check(c);
  return c;
}

void refuse_used_number(const CertifyArguments& arguments) {
  const metrology::History history(arguments.history, metrology::History::Access::read);
  for (const auto& entry : history.entries("certificate")) {
    const Value document = parse_json(entry.document, arguments.history);
    const Value* number = document.find("number");
    if (number != nullptr && number->if_text() != nullptr && *number->if_text() == arguments.number) {
      throw InputError(fmt::format("{}: certificate {} was issued already (entry {}, {}); numbers are unique",
                                   arguments.history, arguments.number, entry.number, entry.date));
    }
  }
}

void refuse_invalid(const CertifyArguments& arguments, const std::string& xml) {
  if (arguments.schema_dir.empty()) return;
  const auto document = reports::XmlDocument::parse(xml, "certificate.xml");
  if (const auto fault = document.fault_after_schema(schema_in(arguments.schema_dir))) {
    throw InputError(fmt::format("the certificate would not be valid after the schema: {}", *fault));
  }
}

/// What lies beside the certificate.
struct Beside {
  std::vector<reports::ArchiveFile> figures;
  std::string data_zip;
};

void write(const CertifyArguments& arguments, const reports::Certificate& certificate,
           const std::optional<reports::SigningKey>& key, const Beside& beside) {
  std::string xml = reports::certificate_dcc(certificate);
  if (key) xml = reports::sign_xml(xml, *key);
  refuse_invalid(arguments, xml);
  const std::string html = reports::certificate_html(certificate);
  const std::string title =
      reports::Catalogue::in(certificate.language)("title.certificate") + " " + certificate.number;
  const std::string pdf =
      reports::archival_pdf(html, {title, certificate.laboratory.address.name, certificate.issued},
                            reports::PdfAttachment{"certificate.xml", "application/xml", title, xml});
  const std::string& server =
      arguments.time_stamp.empty() ? certificate.laboratory.time_stamp_server : arguments.time_stamp;
  std::string pdf_stamp, xml_stamp;
  if (!server.empty()) {
    pdf_stamp = reports::time_stamp(pdf, server);
    xml_stamp = reports::time_stamp(xml, server);
  }
  FolderTransaction folder(arguments.output);
  write_atomically(folder.working() / "certificate.html", html);
  write_atomically(folder.working() / "certificate.pdf", pdf);
  write_atomically(folder.working() / "certificate.xml", xml);
  if (key) write_atomically(folder.working() / "certificate.pdf.p7s", reports::sign_detached(pdf, *key));
  if (!server.empty()) {
    write_atomically(folder.working() / "certificate.pdf.tsr", pdf_stamp);
    write_atomically(folder.working() / "certificate.xml.tsr", xml_stamp);
  }
  write_atomically(folder.working() / "data.zip", beside.data_zip);
  for (const auto& figure : beside.figures) write_atomically(folder.working() / figure.name, figure.bytes);
  if (!arguments.history.empty()) {
    history_to_append(arguments.history)
        .append("certificate",
                Value::object()
                    .set("schema", "fringecal.certificate")
                    .set("schema_version", 1)
                    .set("number", certificate.number)
                    .set("certificate_xml_sha256", sha256_hex(xml))
                    .set("certificate_pdf_sha256", sha256_hex(pdf))
                    .set("data_zip_sha256", certificate.data_sha256),
                certificate.issued);
  }
  folder.commit();
}

void run(const CertifyArguments& arguments) {
  if (!arguments.history.empty()) refuse_used_number(arguments);
  const auto key = key_of(arguments);
  reports::Certificate certificate = certificate_of(arguments);
  if (key) certificate.signer = reports::Signer{key->subject(), key->is_test()};
  Beside beside{reports::figure_files(certificate), {}};
  beside.data_zip = reports::certificate_data(certificate, beside.figures);
  certificate.data_sha256 = sha256_hex(beside.data_zip);
  write(arguments, certificate, key, beside);
  if (arguments.json) {
    fmt::print("{}", to_json(Value::object()
                                 .set("number", certificate.number)
                                 .set("folder", arguments.output)
                                 .set("results", reports::result_lines(certificate).size())
                                 .set("signer", key ? Value(key->subject()) : Value())
                                 .set("test", certificate.is_test())));
    return;
  }
  fmt::print("Certificate {} in {}: {} results, {}{}\n", certificate.number, arguments.output,
             reports::result_lines(certificate).size(), key ? "signed by " + key->subject() : "not signed",
             certificate.is_test() ? "; marked as a test on every page" : "");
}

}  // namespace

void add_certify(CLI::App& app) {
  auto arguments = std::make_shared<CertifyArguments>();
  CLI::App* certify = app.add_subcommand("certify", "Issues a calibration certificate: PDF, HTML and signed XML (DCC)");
  certify->add_option("record", arguments->records, "verification records: files, or with --history numbers of entries")
      ->required();
  certify->add_option("--as-found", arguments->as_found, "records of the state before adjustment");
  certify->add_option("--history", arguments->history,
                      "history that the records are taken from; the certificate is entered in it");
  certify->add_option(
      "--clouds", arguments->clouds,
      "folder of the verification (verify -o), for the residual clouds that its record names; else they "
      "are taken from beside the record's file, where they are there");
  certify->add_option("--lab", arguments->lab, "who certifies (lab.toml)")->required();
  certify->add_option("--customer", arguments->customer, "for whom, and which item (customer.toml)")->required();
  certify->add_option("--number", arguments->number, "number of the certificate, unique in the laboratory")->required();
  certify->add_option("--language", arguments->language, "language of the texts: en (default) or de");
  certify->add_option("--key", arguments->key,
                      "private key of the laboratory, PEM or PKCS#12; without it nothing is signed");
  certify
      ->add_option("--certificate", arguments->certificate,
                   "its X.509 certificates (PEM), where they are not in the key file")
      ->needs("--key");
  certify->add_option(
      "--passphrase-file", arguments->passphrase_file,
      fmt::format("file with the key's passphrase; else the variable {}, else it is asked for", kPassphraseVariable));
  certify->add_option("--timestamp", arguments->time_stamp,
                      "address of a time-stamping authority (RFC 3161, http or https), instead of lab.toml's "
                      "time_stamp_server; asked for PDF and XML, without an answer nothing is written");
  certify->add_option("--schema-dir", arguments->schema_dir,
                      "folder with PTB's schemas: the XML must be valid, or nothing is written");
  certify->add_option("-o,--output", arguments->output, "folder to write")->required();
  certify->add_flag("--json", arguments->json, "print JSON");
  certify->footer(
      "Example: fringecal certify verification.json --lab lab.toml --customer customer.toml --number K-2026-17 "
      "--key key.pem -o K-2026-17");
  certify->callback([arguments] { run(*arguments); });
}

}  // namespace fringecal::cli
