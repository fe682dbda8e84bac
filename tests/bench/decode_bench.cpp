// Decoding beside its bound and its peers, in one run, printed as ratios; then its growth from 0.3 to 50 megapixels.
//   bench_decode [rounds]      FRINGECAL_THREADS=1 or 2: ours and the bound on so many threads
#include "calib/decode/decode.h"
#include "core/parallel.h"
#include "tests/bench/decode_peers.h"
#include "tests/bench/timing.h"
#include "tests/calib/synthetic_fringes.h"

#include <fmt/format.h>

#include <cstdlib>

namespace fringecal::bench {
namespace {

Capture capture_of(int width, int height) {
  test::FringeScene s;
  s.code = {.gray_bits = 7, .phase_steps = 4, .stripes_per_period = 2, .period = 0.24, .unit = "mm"};
  s.along = width;
  s.px_per_period = width / 63.5;
  s.start = 0.2;
  s.read_sd = 1.0;
  // A part of the picture is shadow.
  s.albedo = [width](int a, int) { return a < width / 10 ? 0.02 : 1.0; };
  s.across = std::min(height, 260);  // the rest repeats it: rendering is slow
  Capture out = test::render(s);
  for (GrayImage& frame : out.frames) {
    const Image8& strip = std::get<Image8>(frame);
    Image8 whole(width, height);
    for (int y = 0; y < height; ++y) {
      const auto from = strip.row(y % strip.height());
      std::copy(from.begin(), from.end(), whole.row(y).begin());
    }
    frame = std::move(whole);
  }
  out.info.height_px = height;
  return out;
}

void print(const std::vector<Contender>& contenders, double ours_ms) {
  for (const Contender& c : contenders) {
    fmt::print("    {:<49}{:>10.3f} ms{:>9.2f} x\n", c.name, median(c.times_ms), median(c.times_ms) / ours_ms);
  }
  std::fflush(stdout);
}

void beside_peers(int rounds) {
  const Capture capture = capture_of(1392, 1040);
  const std::size_t pixels = 1392 * 1040;
  std::vector<float> phase(pixels);
  std::vector<std::uint8_t> invalid(pixels);
  DecodePeerTask task{
      .width = 1392, .height = 1040, .frames = {}, .phase_rad = phase.data(), .invalid = invalid.data()};
  for (const std::size_t k : {7, 8, 9, 10, 0, 1, 2, 3, 4, 5, 6}) {
    task.frames.push_back(std::get<Image8>(capture.frames[k]).data());
  }
  decode::PhaseMap least, measuring, all, estimated;
  const auto decode_into = [&](decode::PhaseMap& map, decode::Detail detail, std::optional<double> sigma) {
    map = decode::decode_phase(capture, CodeAxis::x, {.sigma_gray_levels = sigma, .detail = detail}, std::move(map));
  };
  using decode::Detail;
  std::vector<Contender> contenders{
      {"bound: frames read once, outputs written",
       [&] {
         constexpr std::size_t kChunk = 32768;
         parallel_for(static_cast<int>((pixels + kChunk - 1) / kChunk), [&](int chunk) {
           const std::size_t first = static_cast<std::size_t>(chunk) * kChunk;
           native::touch_everything(task, first, std::min(kChunk, pixels - first));
         });
       }},
      {"fringecal: phase and mask, redundant", [&] { decode_into(least, Detail::phase, 1.0); }},
      {"fringecal: modulation and uncertainty too", [&] { decode_into(measuring, Detail::measuring, 1.0); }},
      {"fringecal: everything", [&] { decode_into(all, Detail::all, 1.0); }},
      {"fringecal: phase and mask, noise estimated", [&] { decode_into(estimated, Detail::phase, {}); }},
      {"float loop with libmvec, any x86-64, one thread", [&] { portable::decode_by_float_loop(task); }},
      {"the same for x86-64-v3", [&] { v3::decode_by_float_loop(task); }},
      {"the same for this machine only (-march=native)", [&] { native::decode_by_float_loop(task); }},
      {"cv::phase and friends", [&] { decode_by_opencv(task); }, 4},
  };
  if (const auto structured = structured_light_decoder()) {
    contenders.push_back({"cv::structured_light", [&task, structured] { structured(task); }, 1000});
  } else {
    fmt::print("  left out: cv::structured_light (install libopencv-contrib-dev)\n");
  }
  const bool one = thread_count() == 1;
  race(contenders, rounds, one ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_MONOTONIC);
  fmt::print("  11 frames of 1392 x 1040 on {} thread(s), {}; ratio to the second line\n", thread_count(),
             one ? "processor time" : "clock");
  print(contenders, median(contenders[1].times_ms));
}

void growth() {
  fmt::print("  growth, phase and mask, memory reused\n");
  for (const auto& [width, height] : {std::pair{640, 480}, {1392, 1040}, {2592, 1944}, {4096, 3072}, {8192, 6144}}) {
    const Capture capture = capture_of(width, height);
    decode::PhaseMap map;
    std::vector<Contender> one{{fmt::format("{} x {}", width, height), [&] {
                                  map = decode::decode_phase(
                                      capture, CodeAxis::x, {.sigma_gray_levels = 1.0, .detail = decode::Detail::phase},
                                      std::move(map));
                                }}};
    race(one, 9, CLOCK_PROCESS_CPUTIME_ID);
    const double ms = median(one[0].times_ms), megapixels = 1e-6 * width * height;
    fmt::print("    {:<14}{:>8.1f} megapixels{:>10.3f} ms{:>9.3f} ms per megapixel\n", one[0].name, megapixels, ms,
               ms / megapixels);
    std::fflush(stdout);
  }
}

}  // namespace
}  // namespace fringecal::bench

int main(int argc, char** argv) {
  const int rounds = argc > 1 && std::atoi(argv[1]) > 0 ? std::atoi(argv[1]) : 40;
  fringecal::bench::beside_peers(rounds);
  if (fringecal::thread_count() == 1) fringecal::bench::growth();
  return 0;
}
