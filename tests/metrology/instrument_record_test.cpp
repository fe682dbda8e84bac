// What alignments and calibrations leave in a history, and what a chart makes of it.
#include "metrology/instrument_record.h"
#include "core/error.h"
#include "metrology/history_series.h"
#include "tests/support/sample_verification.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <map>

namespace fringecal::metrology {
namespace {

using test::TemporaryFolder;

InstrumentRecord alignment(int i, double delta_um) {
  InstrumentRecord out{.event = "alignment",
                       .scanner = "scanner \"A\"",  // a text with escapes
                       .ended = "2026-01-0" + std::to_string(i) + "T12:00:00Z",
                       .outcome = "aligned after 1 turns",
                       .provenance = provenance_now()};
  out.quantities = {
      {"delta", "jump of bit 6", "as found", "um", delta_um, 0.5, Limits{-2.4, 2.4}},
      {"delta", "jump of bit 6", "as left", "um", 0.1, 0.5, Limits{-2.4, 2.4}},
      {"temperature", "of the room", "", "degC", 20.0 + i, {}},
  };
  out.provenance.inputs = {{"record.json", std::string(64, static_cast<char>('0' + i))}};
  return out;
}

TEST(InstrumentRecord, ReadsBackAsWritten) {
  const auto before = alignment(1, -53.25);
  const auto after = instrument_record_from(parse_json(to_json(to_value(before)), "x"), "x");
  EXPECT_EQ(to_json(to_value(after)), to_json(to_value(before)));
  EXPECT_EQ(after.scanner, before.scanner);
  ASSERT_EQ(after.quantities.size(), 3u);
  EXPECT_EQ(after.quantities[0].u, 0.5);
  EXPECT_EQ(after.quantities[0].limits->upper, 2.4);
  EXPECT_FALSE(after.quantities[2].u);
}

TEST(InstrumentRecord, OfACalibrationHasTheDistortionCoefficientsOfThePaper) {
  model::Scanner scanner;
  scanner.name = "A";
  scanner.camera.fx_px = 3700;
  scanner.projector.x.emplace();
  scanner.paper_model = model::FittedChen2008{.model = {.kc1_per_mm2 = 1e-4, .kp2_per_mm4 = -2e-9}};
  scanner.uncertainty = {{"camera.fx_px", "proj_from_cam.rotation_x_rad"}, Eigen::Matrix2d::Identity() * 0.25};
  const auto record = record_of(scanner, "2026-01-01T00:00:00Z");
  std::map<std::string, RecordedQuantity> by_symbol;
  for (const auto& q : record.quantities) by_symbol[q.symbol] = q;
  for (const char* symbol : {"kc1", "kc2", "kp1", "kp2"}) EXPECT_TRUE(by_symbol.contains(symbol)) << symbol;
  EXPECT_EQ(by_symbol["kc1"].value, 1e-4);
  EXPECT_EQ(by_symbol["kp2"].value, -2e-9);
  EXPECT_EQ(by_symbol["camera.fx_px"].value, 3700);
  EXPECT_EQ(by_symbol["camera.fx_px"].u, 0.5);
  EXPECT_FALSE(by_symbol.contains("proj_from_cam.rotation_x_rad"));
}

TEST(InstrumentRecord, IsAppendedOnceHoweverOftenARunIsContinued) {
  const TemporaryFolder folder;
  History history(folder.path() / "h.db", History::Access::write);
  EXPECT_EQ(append_once(history, alignment(1, 3)), 1);
  EXPECT_EQ(append_once(history, alignment(2, 4)), 2);
  auto again = alignment(1, 3);
  again.ended = "2026-02-01T00:00:00Z";
  EXPECT_EQ(append_once(history, again), 1);
  EXPECT_EQ(history.size(), 2);
  EXPECT_FALSE(history.check());
}

TEST(HistorySeries, HasTheInstrumentsOwnQuantitiesBesideThoseOfVerifications) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "h.db";
  const Verification v = test::sample_verification();
  {
    History history(file, History::Access::write);
    for (int i = 1; i <= 3; ++i) append_once(history, alignment(i, 10.0 * i));
    history.append("verification", to_value(v), v.ended);
    history.append("certificate", Value::object().set("schema", "other").set("number", "K-2026-\"17\""), v.ended);
  }
  const History history(file, History::Access::read);
  const auto found = series_of(history, {"delta", kScannerItself, "as found"});
  ASSERT_EQ(found.values.size(), 3u);
  EXPECT_EQ(found.values[2].value, 30);
  EXPECT_EQ(found.U[0], 1.0);
  EXPECT_EQ(found.unit, "um");
  EXPECT_EQ(found.limits->lower, -2.4);
  EXPECT_DOUBLE_EQ(found.values[1].day - found.values[0].day, 1);
  EXPECT_EQ(series_of(history, {"delta", kScannerItself, "as left"}).values[2].value, 0.1);
  EXPECT_EQ(series_of(history, {"delta", kScannerItself, {}}).values[2].value, 30);  // the largest
  EXPECT_TRUE(series_of(history, {"delta", "sphere30", {}}).values.empty());

  // The room's temperature: three alignments and what the verification states.
  const auto temperature = series_of(history, {"temperature", "room", {}});
  ASSERT_EQ(temperature.values.size(), 4u);
  EXPECT_EQ(temperature.values[0].value, 21);
  EXPECT_EQ(temperature.values[3].value, v.environment.temperature_degC);

  // Every line of the verification is found as its parser reads it.
  ASSERT_FALSE(v.quantities.empty());
  for (const auto& q : v.quantities) {
    const auto one = series_of(history, {q.symbol, q.artefact, q.position});
    ASSERT_EQ(one.values.size(), 1u) << q.symbol;
    EXPECT_EQ(one.values[0].value, q.value);
    EXPECT_EQ(one.U[0], q.uncertainty.U);
    EXPECT_EQ(one.unit, q.unit);
    EXPECT_EQ(one.name, q.name);
    EXPECT_EQ(one.limits.has_value(), q.limits.has_value());
    EXPECT_EQ(one.numbers[0], 4);
  }
  const auto keys = quantities_of(history);
  EXPECT_EQ(keys.front().symbol, "delta");
  EXPECT_EQ(keys.back().symbol, "temperature");
  history.each([&](const HistoryView& entry) {
    if (entry.kind == "certificate") {
      EXPECT_EQ(summary_of(entry), "No. K-2026-\"17\"");
    }
    if (entry.number == 1) {
      EXPECT_EQ(summary_of(entry), "scanner \"A\": aligned after 1 turns");
    } else if (entry.number == 4) {
      EXPECT_NE(summary_of(entry).find(v.plan), std::string::npos);
    }
  });
}

}  // namespace
}  // namespace fringecal::metrology
