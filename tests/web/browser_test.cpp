// The page in a headless Chromium: what a person clicks ends as what the command line writes. Skipped by name where
// there is no Chromium or chromedriver.
#include "tests/web/browser.h"
#include "core/file.h"
#include "tests/support/long_tests.h"
#include "tests/web/loopback_only.h"
#include "tests/web/served.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>

namespace fringecal::test {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPages[] = {"home", "live", "align", "calibrate", "verify", "cloud", "history"};

#define NEEDS_BROWSER() \
  if (!Browser::installed()) GTEST_SKIP() << "chromium and chromedriver are not installed (Debian: chromium-driver)"

/// Complaints of the browser are the page's faults: scripts that fail, policies that are broken.
const char* const kWatch =
    "window.faults = []; addEventListener('error', e => faults.push(String(e.message)));"
    "addEventListener('unhandledrejection', e => faults.push(String(e.reason)));"
    "document.addEventListener('securitypolicyviolation', e => faults.push(e.violatedDirective + ' ' + e.blockedURI)); "
    "return 1;";

double number_of(const Value& value) {
  return value.if_real() ? *value.if_real() : static_cast<double>(*value.if_integer());
}

std::string faults(Browser& browser) { return browser.text("return window.faults.join('; ');"); }

TEST(Page, IsPaintedInHalfASecondAndAsksForNothingFromElsewhere) {
  NEEDS_BROWSER();
  const ScratchFolder folder;
  Served served(folder.path());
  Browser browser;
  browser.open(served.address());
  ASSERT_TRUE(browser.wait_for("document.getElementById('next')", 30));
  // The best of five: what the page takes, not what else the machine does at the moment.
  double ms = 1e9;
  for (int i = 0; i < 5; ++i) {
    browser.open("http://" + served.host() + "/");
    ASSERT_TRUE(browser.wait_for("document.getElementById('next')", 30));
    ASSERT_TRUE(browser.wait_for("performance.getEntriesByName('first-contentful-paint').length", 30));
    ms = std::min(
        ms, number_of(browser.evaluate("return performance.getEntriesByName('first-contentful-paint')[0].startTime;")));
  }
  std::printf("first contentful paint after %.0f ms\n", ms);
  EXPECT_LT(ms, 500);
  EXPECT_EQ(browser.text("return performance.getEntriesByType('resource').map(e => e.name).filter(n => "
                         "!n.startsWith(location.origin)).join(' ');"),
            "");
}

TEST(Page, ShowsTheVirtualCamerasPictureAndItsFigures) {
  NEEDS_BROWSER();
  const ScratchFolder folder;
  Served served(folder.path());
  Browser browser;
  browser.open(served.address());
  ASSERT_TRUE(browser.wait_for("document.getElementById('next')", 30));
  browser.evaluate("location.hash = '#/live'; return 1;");
  browser.click("#live");
  ASSERT_TRUE(browser.wait_for("document.getElementById('sharpness')", 60))
      << browser.text("return document.querySelector('main').innerText;");
  // The best two seconds of at most eight: what the path can do, not what else the machine does at the moment.
  const double rate = number_of(browser.evaluate(
      "let best = 0; for (let i = 0; i < 40 && best < 10; ++i) { await new Promise(r => setTimeout(r, 200));"
      "if (i >= 10) best = Math.max(best, parseFloat(document.getElementById('rate').textContent)); } return best;"));
  std::printf("%.1f pictures per second, %s ms each in the page\n", rate,
              browser.text("return document.querySelector('canvas').dataset.ms;").c_str());
  EXPECT_GE(rate, 10);
  // Not one grey: fringes on spheres are bright and dark.
  const Value spread = browser.evaluate(
      "const c = document.querySelector('canvas'), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
      "let low = 255, high = 0; for (let i = 0; i < d.length; i += 4) { low = Math.min(low, d[i]); high = "
      "Math.max(high, d[i]); }"
      "return high - low;");
  EXPECT_GT(*spread.if_integer(), 50);
  if (const char* to = std::getenv("FRINGECAL_SCREENSHOTS")) browser.screenshot(fs::path(to) / "live-picture.png");
  browser.click("#live");
}

TEST(Page, EveryPageShowsInBothLanguagesAndThemesWithoutAFault) {
  NEEDS_BROWSER();
  const ScratchFolder folder;
  Served served(folder.path());
  Browser browser;
  browser.open(served.address());
  ASSERT_TRUE(browser.wait_for("document.getElementById('next')", 30));
  browser.evaluate(kWatch);
  for (int language = 0; language < 2; ++language) {
    for (const std::string page : kPages) {
      browser.evaluate("location.hash = '#/" + page + "'; return 1;");
      EXPECT_TRUE(browser.wait_for("document.querySelector('nav a[aria-current]')?.hash === '#/" + page +
                                       "' && document.querySelector('main h1')",
                                   20))
          << page;
      // No key of the catalogue is left as text: a word with a dot between letters and no spaces.
      EXPECT_EQ(browser.text("return [...document.querySelectorAll('main *, nav *')].flatMap(e => "
                             "[...e.childNodes]).filter(n => n.nodeType === 3 && "
                             "/^[a-z]+\\.[a-z.]+$/.test(n.data.trim())).map(n => n.data).join(' ');"),
                "")
          << page;
      EXPECT_EQ(
          browser.text("return document.documentElement.scrollWidth > innerWidth ? 'wider than the window' : '';"), "")
          << page;
    }
    browser.click("#language");
    browser.click("#theme");
  }
  EXPECT_EQ(browser.text("return performance.getEntriesByType('resource').map(e => e.name).filter(n => "
                         "!n.startsWith(location.origin)).join(' ');"),
            "");
  EXPECT_EQ(faults(browser), "");
}

/// Whatever the browser itself looks for, the page needs nothing of it.
TEST(Page, EveryPageShowsInANetworkWithoutInterfaces) {
  NEEDS_BROWSER();
  if (!network_namespaces()) GTEST_SKIP() << "unshare -rn with ip is not permitted here, or not installed";
  const auto run = run_in_loopback_only("Page.EveryPageShowsInBoth*");
  EXPECT_EQ(run.status, 0) << run.output;
  EXPECT_NE(run.output.find("[  PASSED  ] 1 test"), std::string::npos) << run.output;
}

/// A plane of 60 x 60 points 1 mm apart, three of which stand 5 mm off; as any other program would write it.
std::string cloud_with_three_outliers() {
  std::string out =
      "ply\nformat ascii 1.0\nelement vertex 3600\nproperty double x\nproperty double y\nproperty double z\n"
      "end_header\n";
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 60; ++x) {
      const bool off = (x == 20 && y == 20) || (x == 40 && y == 20) || (x == 30 && y == 45);
      // Heights between 0 and 0.06 mm without a pattern: an outlier filter needs something that is usual.
      const double z = off ? 5 : 0.01 * ((x * 7 + y * 11 + x * y) % 7);
      out += std::to_string(x) + " " + std::to_string(y) + " " + std::to_string(z) + "\n";
    }
  }
  return out;
}

/// A wavy surface of 1400 x 1000 points as a binary PLY.
std::string large_cloud() {
  constexpr int kColumns = 1400, kRows = 1000;
  std::string out =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1400000\nproperty float x\nproperty float y\nproperty "
      "float "
      "z\nend_header\n";
  out.reserve(out.size() + 12 * kColumns * kRows);
  for (int y = 0; y < kRows; ++y) {
    for (int x = 0; x < kColumns; ++x) {
      const float point[] = {0.5f * static_cast<float>(x), 0.5f * static_cast<float>(y),
                             20 * std::sin(0.01f * static_cast<float>(x)) * std::cos(0.01f * static_cast<float>(y))};
      out.append(reinterpret_cast<const char*>(point), sizeof point);
    }
  }
  return out;
}

TEST(Page, ACloudIsShownFilteredMeasuredAndCut) {
  NEEDS_BROWSER();
  if (!fs::exists("/usr/share/javascript/three/build/three.module.js")) GTEST_SKIP() << "libjs-three is not installed";
  const ScratchFolder folder;
  fs::create_directories(folder / "clouds");
  folder.write("clouds/plane.ply", cloud_with_three_outliers());
  Served served(folder.path());
  Browser browser(Browser::Drawing::webgl);
  browser.open(served.address());
  ASSERT_TRUE(browser.wait_for("document.getElementById('next')", 30));
  browser.evaluate(kWatch);
  browser.evaluate("localStorage.setItem('fringecal.drawing', 'webgl'); return 1;");
  browser.evaluate("location.hash = '#/cloud'; return 1;");
  const auto said = [&] { return browser.text("return document.querySelector('main').innerText;"); };
  ASSERT_TRUE(browser.wait_for("document.getElementById('shown')?.textContent.startsWith('3,600 of 3,600')", 60))
      << said();
  browser.click("#outliers");
  EXPECT_TRUE(browser.wait_for("document.querySelector('main').innerText.includes('3 points removed')", 20)) << said();
  EXPECT_TRUE(browser.wait_for("document.getElementById('shown').textContent.startsWith('3,597')", 20)) << said();
  // The keyboard: the middle of the plane from the front, then another point after a turn.
  browser.evaluate(
      "[...document.querySelectorAll('main button')].find(b => b.textContent === 'Front').click();"
      "const c = document.querySelector('canvas'), key = k => c.dispatchEvent(new KeyboardEvent('keydown', {key: k}));"
      "key('Enter'); for (let i = 0; i < 5; ++i) key('ArrowLeft'); key('Enter'); return 1;");
  EXPECT_TRUE(browser.wait_for("/ mm \\(ΔX/.test(document.querySelector('main').innerText)", 20)) << said();
  EXPECT_EQ(faults(browser), "");
}

/// Turned for seconds, drawn by software: the number of points follows the time that a frame takes. At rest all are there.
TEST(Page, ACloudOf1400000PointsTurnsSmoothlyWithoutAGraphicsProcessor) {
  NEEDS_BROWSER();
  if (!fs::exists("/usr/share/javascript/three/build/three.module.js")) GTEST_SKIP() << "libjs-three is not installed";
  const ScratchFolder folder;
  fs::create_directories(folder / "clouds");
  folder.write("clouds/large.ply", large_cloud());
  Served served(folder.path());
  Browser browser;
  browser.open(served.address());
  ASSERT_TRUE(browser.wait_for("document.getElementById('next')", 30));
  browser.evaluate(kWatch);
  browser.evaluate("location.hash = '#/cloud'; return 1;");
  ASSERT_TRUE(browser.wait_for("document.getElementById('shown')?.textContent.startsWith('1,400,000 of')", 60));
  // Half a second each, turned a little before every frame; the first ones are for the budget to settle.
  const Value rates = browser.evaluate(
      "const c = document.querySelector('canvas'), out = [];"
      "for (let i = 0; i < 8; ++i) { const from = Number(c.dataset.frames), begin = performance.now(); let most = 0;"
      "while (performance.now() - begin < 500) { c.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowLeft'}));"
      "await new Promise(requestAnimationFrame); }"
      "out.push(1000 * (Number(c.dataset.frames) - from) / (performance.now() - begin)); }"
      "return {rates: out, shown: document.getElementById('shown').textContent};");
  double best = 0;
  for (const Value& rate : *rates.find("rates")->if_array()) {
    std::printf("%.1f ", number_of(rate));
    best = std::max(best, number_of(rate));
  }
  std::printf("frames per second, %s\n", rates.find("shown")->if_text()->c_str());
  // The best half second: what the page reaches, not what else the machine does at the moment.
  EXPECT_GE(best, 30);
  EXPECT_TRUE(browser.wait_for("document.getElementById('shown').textContent.startsWith('1,400,000 of')", 30));
  EXPECT_EQ(faults(browser), "");
}

/// A verification of the plan "quick" whose one capture is evaluated: a sphere of 50 mm with 400 points of its cap.
void write_verification(const ScratchFolder& folder) {
  const std::string name = "verification-quick-20260101T000000Z/";
  fs::create_directories(folder / (name + "captures"));
  fs::create_directories(folder / (name + "clouds"));
  folder.write(name + "captures/morning-00.json",
               R"({"schema": "fringecal.capture-result", "schema_version": 1, "capture": 0, "features": [{"artefact":
"sphere50", "part": 0, "diameter_mm": 49.9987, "u_noise_mm": 0.001, "u_calibration_mm": 0.002, "range_mm": 0.1,
"shell_95_mm": 0.08, "sd_mm": 0.02, "place_mm": [95.0, 75.0, 0.0], "n_points": 400, "n_rejected": 1}],
"distances": []})");
  std::string cloud =
      "ply\nformat ascii 1.0\nelement vertex 400\nproperty float x\nproperty float y\nproperty float z\nproperty float "
      "deviation\nproperty uchar rejected\nend_header\n";
  for (int i = 0; i < 400; ++i) {
    const double x = i % 20 - 9.5, y = i / 20 - 9.5, off = 0.001 * (i % 41 - 20);
    const double z = std::sqrt((25 + off) * (25 + off) - x * x - y * y);
    cloud += std::to_string(95 + x) + " " + std::to_string(75 + y) + " " + std::to_string(z) + " " +
             std::to_string(off) + " 0\n";
  }
  folder.write(name + "clouds/morning-00-1.ply", cloud);
}

TEST(Page, AVerificationIsShownInSpaceWithItsFits) {
  NEEDS_BROWSER();
  if (!fs::exists("/usr/share/javascript/three/build/three.module.js")) GTEST_SKIP() << "libjs-three is not installed";
  const ScratchFolder folder;
  write_verification(folder);
  Served served(folder.path());
  served.sign_in();
  EXPECT_EQ(
      served.get("/api/verification/cloud?name=verification-quick-20260101T000000Z&cloud=../captures/morning-00.json")
          .status,
      422);
  Browser browser;
  browser.open(served.program().line());  // the next one-time address
  ASSERT_TRUE(browser.wait_for("document.getElementById('job')", 30));
  browser.evaluate(kWatch);
  browser.evaluate("location.hash = '#/verify'; return 1;");
  EXPECT_TRUE(browser.wait_for("document.getElementById('space')?.dataset.shown === '400'", 60))
      << browser.text("return document.querySelector('main').innerText;");
  browser.click(".tiles li.done button");
  EXPECT_TRUE(browser.wait_for("/sphere50\\s+49.9987 mm/.test(document.querySelector('main').innerText)", 20))
      << browser.text("return document.querySelector('main').innerText;");
  // The scale of the map holds all but a fortieth of the 400 deviations of up to 0.020 mm.
  EXPECT_EQ(
      browser.text("return document.querySelector('.deviation-scale').innerText.trim().split(/\\s+/).pop() + ' ' +"
                   "document.querySelector('.deviation-scale').lastElementChild.textContent;"),
      "mm 0.020 mm");
  EXPECT_EQ(faults(browser), "");
}

/// A commissioning by clicks, with a reload, a second window and a killed server on the way, against the same one on the
/// command line. About a minute of one core each.
TEST(Page, ACommissioningByClicksEndsWithTheReportOfTheCommandLine) {
  NEEDS_BROWSER();
  if (!long_tests()) GTEST_SKIP() << "two whole commissionings; FRINGECAL_LONG=1 runs them";
  setenv("SOURCE_DATE_EPOCH", "1700000000", 1);  // or else dates and durations differ
  const ScratchFolder folder;
  auto served = std::make_unique<Served>(folder.path());
  const int port = served->port();
  Browser browser;
  browser.open(served->address());
  browser.wait_for("document.getElementById('seed')", 30);
  browser.evaluate(
      "document.getElementById('seed').value = '5'; document.getElementById('repeats').value = '1'; return 1;");
  browser.click("#next");
  ASSERT_TRUE(browser.wait_for("document.getElementById('job').dataset.state === 'running'", 30));
  browser.open("http://" + served->host() + "/#/align");  // a reload, on another page
  ASSERT_TRUE(browser.wait_for("document.getElementById('delta')", 120));
  served->program().send(SIGKILL);
  served->program().wait();
  served = std::make_unique<Served>(folder.path(), port);
  browser.open("http://" + served->host() + "/#/home");
  ASSERT_TRUE(browser.wait_for("document.getElementById('job').dataset.state === 'running'", 60)) << "the job is lost";
  browser.click("#stop");
  ASSERT_TRUE(browser.wait_for("document.getElementById('job').dataset.state === 'ended'", 60));
  browser.click("#next");  // continue
  ASSERT_TRUE(browser.wait_for("document.getElementById('job').dataset.state === 'running'", 60));
  for (int i = 0; i < 20 && !fs::exists(folder / "commissioning" / "report.json"); ++i) {
    browser.wait_for("document.getElementById('job').dataset.state === 'ended'", 30);
  }
  ASSERT_TRUE(browser.wait_for("document.getElementById('job').dataset.state === 'ended'", 60));
  ASSERT_EQ(run_fringecal(
                {"commission", "--virtual", "--seed", "5", "--repeats", "1", "--output", (folder / "line").string()})
                .exit_code,
            0);
  EXPECT_EQ(sha256_of_file(folder / "commissioning" / "report.json"), sha256_of_file(folder / "line" / "report.json"));
  unsetenv("SOURCE_DATE_EPOCH");
}

/// FRINGECAL_SCREENSHOTS=FOLDER and FRINGECAL_WORKBENCH=FOLDER: every page of that workbench at both sizes in both
/// themes, to be looked at.
TEST(Page, ScreenshotsToLookAt) {
  NEEDS_BROWSER();
  const char *to = std::getenv("FRINGECAL_SCREENSHOTS"), *bench = std::getenv("FRINGECAL_WORKBENCH");
  if (!to || !bench) GTEST_SKIP() << "FRINGECAL_SCREENSHOTS and FRINGECAL_WORKBENCH name no folders";
  Served served(bench);
  Browser browser(Browser::Drawing::webgl);
  browser.open(served.address());
  ASSERT_TRUE(browser.wait_for("document.getElementById('next') || document.getElementById('job').dataset.state", 30));
  browser.evaluate(kWatch);
  for (const auto& [size, width, height] : {std::tuple("wide", 1280, 720), std::tuple("tablet", 820, 1180)}) {
    browser.resize(width, height);
    for (const char* theme : {"light", "dark"}) {
      browser.evaluate(std::string("if (document.documentElement.dataset.theme !== '") + theme +
                       "') document.getElementById('theme').click(); return 1;");
      for (const std::string page : kPages) {
        browser.evaluate("location.hash = '#/" + page + "'; return 1;");
        browser.wait_for("document.querySelector('nav a[aria-current]').hash === '#/" + page + "'", 20);
        browser.evaluate("await new Promise(r => setTimeout(r, 2500)); return 1;");
        browser.screenshot(fs::path(to) / (page + "-" + size + "-" + theme + ".png"));
        EXPECT_EQ(
            browser.text("return document.documentElement.scrollWidth > innerWidth ? 'wider than the window' : '';"),
            "")
            << page << " " << size;
      }
    }
  }
  EXPECT_EQ(faults(browser), "");
}

}  // namespace
}  // namespace fringecal::test
