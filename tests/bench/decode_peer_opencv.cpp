#include <opencv2/core.hpp>
#ifdef FRINGECAL_HAVE_STRUCTURED_LIGHT
#include <opencv2/structured_light.hpp>
#endif

#include "tests/bench/decode_peers.h"

#include <numbers>

namespace fringecal::bench {
namespace {

cv::Mat frame(const DecodePeerTask& task, std::size_t k) {
  return {task.height, task.width, CV_8U, const_cast<std::uint8_t*>(task.frames[k])};
}

}  // namespace

void decode_by_opencv(const DecodePeerTask& task) {
  cv::Mat s, c, wrapped, modulation, sum, mean, stripes, bit, order;
  cv::subtract(frame(task, 1), frame(task, 3), s, cv::noArray(), CV_32F);
  cv::subtract(frame(task, 0), frame(task, 2), c, cv::noArray(), CV_32F);
  cv::phase(c, s, wrapped);  // [0, 2 pi)
  cv::magnitude(c, s, modulation);
  cv::add(frame(task, 0), frame(task, 1), sum, cv::noArray(), CV_16U);
  cv::add(sum, frame(task, 2), sum, cv::noArray(), CV_16U);
  cv::add(sum, frame(task, 3), sum, cv::noArray(), CV_16U);
  sum.convertTo(mean, CV_8U, 0.25);
  stripes = cv::Mat::zeros(task.height, task.width, CV_8U);
  for (std::size_t k = 4; k < task.frames.size(); ++k) {
    cv::Mat gray;
    cv::compare(frame(task, k), mean, gray, cv::CMP_GT);
    if (k == 4) {
      bit = gray;
    } else {
      cv::bitwise_xor(bit, gray, bit);
    }
    cv::addWeighted(stripes, 2.0, bit, 1.0 / 255.0, 0.0, stripes);
  }
  stripes.convertTo(order, CV_32F, 0.5, -0.25);
  order.convertTo(order, CV_32S);
  order.convertTo(order, CV_32F, 2 * std::numbers::pi);
  cv::Mat phase(task.height, task.width, CV_32F, task.phase_rad), invalid(task.height, task.width, CV_8U, task.invalid);
  cv::add(order, wrapped, phase);
  cv::compare(modulation, 8.0, invalid, cv::CMP_LT);
}

std::function<void(const DecodePeerTask&)> structured_light_decoder() {
#ifdef FRINGECAL_HAVE_STRUCTURED_LIGHT
  return [](const DecodePeerTask& task) {
    cv::structured_light::SinusoidalPattern::Params params;
    params.width = task.width;
    params.height = task.height;
    params.nbrOfPeriods = 64;
    params.setMarkers = false;
    params.methodId = cv::structured_light::PSP;
    const auto pattern = cv::structured_light::SinusoidalPattern::create(
        cv::makePtr<cv::structured_light::SinusoidalPattern::Params>(params));
    const std::vector<cv::Mat> frames{frame(task, 0), frame(task, 1), frame(task, 2)};
    cv::Mat wrapped, mask, unwrapped;
    pattern->computePhaseMap(frames, wrapped, mask);
    pattern->unwrapPhaseMap(wrapped, unwrapped, {task.width, task.height}, mask);
  };
#else
  return {};
#endif
}

}  // namespace fringecal::bench
