// A calibration certificate: what it says, before it is said in HTML, PDF or XML. Content after ISO/IEC 17025:2017, 7.8.2,
// 7.8.4 and 7.8.6.
//
// Nothing metrological is computed here. A result line is a Quantity of a verification record with its numbers rounded
// for people: U with two significant digits, the value to the same place [GUM, 7.2.6]. HTML and XML print the *same*
// texts of a line, so they cannot differ by rounding.
//
// lab.toml ("fringecal.laboratory", version 1) and customer.toml ("fringecal.customer", version 1): keys are the members
// below; an address is a table [address]; persons are [[persons]]; the item is [item]; an amendment is [amendment].
// A file above 1 MB is refused. All readers throw InputError.
#pragma once

#include "metrology/verification.h"
#include "reports/archive.h"
#include "reports/catalogue.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace fringecal::reports {

/// Texts are UTF-8 of any length; empty: not stated.
struct Address {
  std::string name, street, street_no, post_code, city;
  std::string country_code;  // ISO 3166-1, "DE"
  std::string email, phone, web;
};

struct Person {
  std::string name, role;
  bool main_signer = false;
};

struct Laboratory {
  Address address;
  std::string accreditation;         // its number, as the accreditation body writes it
  std::string place = "laboratory";  // where the item was calibrated: DCC performanceLocation
  std::string time_stamp_server;     // address; empty: no time stamps unless asked for
  std::string procedure;             // number of the working instruction
  std::vector<Person> persons;       // who authorise certificates; at least one
  bool test = false;                 // certificates of this laboratory are marked as tests on every page
};

struct Item {
  std::string name, manufacturer, model, serial_number, inventory_number;
  std::string condition;
  std::string received;  // YYYY-MM-DD
};

struct Amendment {
  bool replaces = false;  // false: amends
  std::string number, reason;
};

struct Customer {
  Address address;
  std::string order;
  Item item;
  std::string recalibration_date;  // YYYY-MM-DD; only where agreed with the customer [ISO/IEC 17025, 7.8.4.3]
  std::string remarks;
  std::optional<Amendment> amendment;
};

Laboratory read_laboratory(const std::filesystem::path& file);
Customer read_customer(const std::filesystem::path& file);

/// One verification record and where it was found.
struct Record {
  metrology::Verification verification;
  std::string document, sha256;        // the JSON as it stands in its file or in the history, and its hash
  std::optional<std::int64_t> entry;   // number of the history's entry ...
  std::string entry_hash, entry_date;  // ... its hash and date
  bool as_found = false;               // before adjustment
  std::vector<ArchiveFile> clouds;     // residual clouds that the record names, as far as they are there
};

/// A result of the item that the history holds, of this record or of an earlier one.
struct PastResult {
  std::int64_t entry = 0;
  std::string kind, date;  // "verification", "alignment"; RFC 3339 UTC
  std::string symbol, name, artefact, position, unit;
  double value = 0;
  std::optional<double> U;  // absent: not stated
  std::optional<metrology::Limits> limits;
};

struct Signer {
  std::string subject;  // "CN=..., O=..."
  bool test = false;    // the key says that it is one
};

struct Certificate {
  bool is_report = false;  // short of a certificate: no number, no signature, parties may be unknown
  std::string number, language = "en";
  std::string issued;  // RFC 3339 UTC
  Laboratory laboratory;
  Customer customer;
  std::vector<Record> records;
  std::vector<PastResult> past;  // of the item, in the history's order; empty without a history
  std::optional<Signer> signer;
  std::string data_sha256;  // of data.zip; empty: there is none

  bool is_test() const { return laboratory.test || (signer && signer->test); }
};

/// One line of the table of results. Numbers are decimal texts with an ASCII minus ("-0.0123", "1.0E-7").
struct ResultLine {
  int number = 0;  // 1, 2, ... through all records
  std::string symbol, name, artefact, position, unit;
  std::string value, U, k, coverage_percent;
  std::optional<std::string> lower, upper;
  std::optional<metrology::Verdict> verdict;
  bool as_found = false;
  const metrology::Quantity* quantity = nullptr;  // of the certificate's record
};

std::vector<ResultLine> result_lines(const Certificate& certificate);

/// A number of a record for print beside its standard uncertainty: value and U = k u, rounded together.
struct Stated {
  std::string value, U;
};
Stated stated(double value, double U);
/// Two significant digits: a standard uncertainty by itself.
std::string two_digits(double u);
/// The fewest digits that read back.
std::string exact(double value);

/// Lines whose uncertainty budget is printed: for each symbol the one that comes closest to its limit, else the largest U.
std::vector<ResultLine> lines_with_budget(const std::vector<ResultLine>& lines);

/// A field of RFC 4180, in quotation marks where it needs them.
std::string csv_field(const std::string& words);
/// number,symbol,name,artefact,position,unit,value,U,k,lower_limit,upper_limit,conformity,state; RFC 4180.
std::string results_csv(const Certificate& certificate);

/// Contradictions that no certificate may carry (no record, no result, dates in the wrong order, a number without
/// letters or digits, a coverage factor below 1): InputError.
void check(const Certificate& certificate);

}  // namespace fringecal::reports
