// Finding a calibration board in a camera image, and the projector coordinate of each of its corners.
#pragma once

#include "calib/decode/corrections.h"
#include "calib/model/board.h"
#include "calib/model/scanner.h"
#include "core/result.h"

#include <filesystem>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace fringecal::calib {

/// Corners (chessboard: saddle points; grids: centres of circles) with sub-pixel places and their standard uncertainty.
/// Image: the mean of the phase frames, or white. No result: the board is not there, with the sentence why.
/// Where a regular pattern looks the same turned by 180 degrees the choice is made so that columns run with the image's
/// x; all captures of one call must show the board within +-90 degrees of each other.
Result<model::BoardObservation> detect_board(const GrayImage& image, const model::Board& board);

/// Fills in x or y (by the map's axis) of each corner from a local robust fit of the phase around it; corners without
/// enough valid phase lose the coordinate. The window spans at least one period, so that what repeats with the period
/// (step errors, harmonics) averages out.
void add_projector_coordinates(model::BoardObservation& observation, const decode::PhaseMap& map);

/// Picture of a capture without fringes: mean of the phase frames; else white; else the mean of all frames.
Image<float> texture_of(const Capture& capture);

/// texture_of, detect_board, decode on every coded axis with the corrections of decode/corrections.h (table: where it
/// was measured, for its axis), add_projector_coordinates.
Result<model::BoardObservation> observe_board(const Capture& capture, const model::Board& board,
                                              const std::string& name,
                                              const model::PhaseLinearisation* table = nullptr);

/// A capture in which the board could not be used, and the sentence why.
struct DroppedPose {
  std::string name, reason;
};

/// The views of a board in a set of captures.
struct BoardViews {
  std::vector<model::BoardObservation> observations;
  std::vector<DroppedPose> dropped;
  int width_px = 0, height_px = 0;
  PatternPlan plan;
  std::vector<std::pair<std::string, std::string>> inputs;  // name and SHA-256 of each capture's capture.json
};

/// Reads the captures one after the other; observe_board for each. Throws InputError where a capture cannot be read, or
/// where its image size or code differs from the first one's.
BoardViews observe_captures(std::span<const std::filesystem::path> folders, const model::Board& board,
                            const model::PhaseLinearisation* table = nullptr);

}  // namespace fringecal::calib
