// The page in a headless Chromium: what a person clicks ends as what the command line writes. Skipped by name where
// there is no Chromium or chromedriver.
#include "tests/web/browser.h"
#include "core/file.h"
#include "tests/support/long_tests.h"
#include "tests/web/served.h"

#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
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
    const Value paint = browser.evaluate("return performance.getEntriesByName('first-contentful-paint')[0].startTime;");
    ms = std::min(ms, paint.if_real() ? *paint.if_real() : static_cast<double>(*paint.if_integer()));
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
  browser.evaluate("await new Promise(r => setTimeout(r, 3000)); return 1;");
  std::printf("%s pictures per second\n", browser.text("return document.getElementById('rate').textContent;").c_str());
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
  EXPECT_EQ(faults(browser), "");
}

/// A plane of 60 x 60 points 1 mm apart, three of which stand 5 mm off.
std::string cloud_with_three_outliers() {
  std::string out =
      "ply\nformat ascii 1.0\nelement vertex 3600\nproperty double x\nproperty double y\nproperty double z\n"
      "property ushort pixel_x\nproperty ushort pixel_y\nend_header\n";
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 60; ++x) {
      const bool off = (x == 20 && y == 20) || (x == 40 && y == 20) || (x == 30 && y == 45);
      // Heights between 0 and 0.06 mm without a pattern: an outlier filter needs something that is usual.
      const double z = off ? 5 : 0.01 * ((x * 7 + y * 11 + x * y) % 7);
      out += std::to_string(x) + " " + std::to_string(y) + " " + std::to_string(z) + " " + std::to_string(x) + " " +
             std::to_string(y) + "\n";
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
