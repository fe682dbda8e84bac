// A verification record with realistic results, and the files of a laboratory and its customer, for tests of certificates.
#pragma once

#include "metrology/verification.h"

#include <filesystem>
#include <string>

namespace fringecal::test {

/// PF, PS, SD and F of an acceptance test after VDI/VDE 2634 with limits and judgements, D without limits; budgets of
/// five contributions each. `shift_mm` is added to every value.
metrology::Verification sample_verification(double shift_mm = 0);

/// Places and residual clouds of its artefacts at three positions each; the clouds are written below the folder.
void add_features(metrology::Verification& verification, const std::filesystem::path& folder);

/// lab.toml and customer.toml. free_text goes into the customer's remarks, the item's condition and the names.
std::string sample_laboratory(bool test = false);
std::string sample_customer(const std::string& free_text = "Two light scratches on the housing.");

}  // namespace fringecal::test
