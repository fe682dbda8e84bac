// The few elements of vector graphics that certificates draw by themselves; coordinates in px, rounded to 0.1 px.
#pragma once

#include <string>

namespace fringecal::reports::svg {

inline constexpr const char* kInk = "#1b1f24";
inline constexpr const char* kBlue = "#0b5a7a";
inline constexpr const char* kQuiet = "#b9c0c8";
inline constexpr const char* kBeyond = "#d5d9de";  // beyond a limit

/// The opening tag of a picture that carries everything inside; close it with kEnd.
std::string begin(const char* kind, double width, double height);
inline constexpr const char* kEnd = "</svg>";

std::string line(double x1, double y1, double x2, double y2, const char* colour, double width,
                 const char* dashes = nullptr);
/// anchor: "start", "middle", "end". The words are data, never markup.
std::string words(double x, double y, const char* anchor, const std::string& words, double size = 10.5);
/// fill: a colour or "none".
std::string box(double x, double y, double width, double height, const char* fill, const char* stroke = "none",
                double stroke_width = 0);

/// Marks that differ by form, not by colour.
enum class Mark { disc, circle, square, triangle, diamond, cross };
std::string mark(Mark mark, double x, double y, double radius = 3.6);

}  // namespace fringecal::reports::svg
