#include "tests/fuzz/readers.h"

#include "calib/corner_files.h"
#include "calib/lens_files.h"
#include "core/capture.h"
#include "core/error.h"
#include "core/file.h"
#include "core/image_file.h"
#include "core/import_plan.h"
#include "core/point_file.h"
#include "core/value.h"
#include "hw/device_address.h"
#include "hw/mewtocol.h"
#include "hw/scanner_file.h"
#include "hw/virtual/scene.h"
#include "metrology/artefact_file.h"
#include "metrology/history.h"
#include "metrology/plan.h"
#include "metrology/point_cloud.h"
#include "metrology/verification.h"
#include "reports/artefact_certificate.h"
#include "reports/certificate.h"
#include "tests/fuzz/device_readers.h"
#include "tests/metrology/exact_phase_map.h"
#include "tests/support/sample_verification.h"

#include <fstream>
#include <random>

namespace fringecal::test {
namespace {

using Path = std::filesystem::path;
using Bytes = std::string_view;

std::string text_of(const Path& in_source) { return read_bytes(Path(FRINGECAL_SOURCE_DIR) / in_source); }

/// A reader of bytes; InputError is its answer to unusable ones.
Reader of_bytes(std::string name, std::vector<std::string> examples, std::function<void(Bytes)> read) {
  const auto guarded = [read](Bytes bytes) {
    try {
      read(bytes);
    } catch (const InputError&) {
    } catch (const hw::mewtocol::MewtocolError&) {
    }
  };
  return {std::move(name), std::move(examples), guarded, read};
}

Capture small_capture() {
  Capture capture;
  capture.info.plan.x =
      FringeCode{.gray_bits = 1, .phase_steps = 3, .stripes_per_period = 1, .period = 2, .unit = "mm"};
  capture.info.plan.patterns = {{PatternKind::gray, CodeAxis::x, 0},
                                {PatternKind::phase, CodeAxis::x, 0},
                                {PatternKind::phase, CodeAxis::x, 1},
                                {PatternKind::phase, CodeAxis::x, 2}};
  capture.info.width_px = 5;
  capture.info.height_px = 3;
  capture.info.exposure_ms = 20;
  capture.info.temperatures_degC["camera"] = 23.5;
  capture.info.devices["camera"] = "A102k";
  for (const Pattern& p : capture.info.plan.patterns) {
    capture.info.frames.push_back({.file = "", .pattern = p, .sha256 = "", .time = ""});
    capture.frames.emplace_back(Image8(5, 3, 77));
  }
  return capture;
}

std::string gauge_text() {
  metrology::Gauge g;
  g.name = "sphere30";
  g.diameter_mm = {30.0043};
  g.U_diameter_mm = 0.0006;
  g.expansion_per_K = 5.5e-6;
  g.certificate = "K-1";
  g.laboratory = "D-K-00000";
  g.date = "2026-01-01";
  g.valid_until = "2028-01-01";
  return metrology::to_toml({g});
}

/// Two entries, in a file of five pages.
std::string history_bytes(const Path& file) {
  {
    metrology::History history(file, metrology::History::Access::write);
    history.append("alignment", Value::object().set("theta_mrad", Value(0.25)), "2026-01-01T00:00:00Z");
    history.append("verification", Value::object(), "2026-01-02T00:00:00Z");
  }
  return read_bytes(file);
}

std::string bmp() {
  std::string out = "BM";
  const auto put = [&](std::uint32_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) out += static_cast<char>(value >> (8 * i));
  };
  put(14 + 40 + 1024 + 24, 4), put(0, 4), put(14 + 40 + 1024, 4);     // file size, 0, offset of the rows
  put(40, 4), put(5, 4), put(3, 4), put(1, 2), put(8, 2), put(0, 4);  // 5 x 3, 8 bits, not compressed
  put(24, 4), put(2835, 4), put(2835, 4), put(256, 4), put(0, 4);
  for (std::uint32_t i = 0; i < 256; ++i) put(i * 0x010101u, 4);
  return out + std::string(24, 'x');
}

constexpr const char* kDcc =
    R"(<?xml version="1.0"?><dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc" xmlns:si="https://ptb.de/si" schemaVersion="3.3.0">
<dcc:administrativeData><dcc:coreData><dcc:uniqueIdentifier>1 PTB 26</dcc:uniqueIdentifier><dcc:endPerformanceDate>2026-03-01</dcc:endPerformanceDate></dcc:coreData>
<dcc:items><dcc:item><dcc:name><dcc:content>Sphere 30</dcc:content></dcc:name></dcc:item></dcc:items></dcc:administrativeData>
<dcc:measurementResults><dcc:measurementResult><dcc:results><dcc:result><dcc:data>
<dcc:quantity><dcc:name><dcc:content lang="de">Durchmesser</dcc:content></dcc:name><si:real><si:value>0.0300043</si:value><si:unit>\metre</si:unit>
<si:expandedUnc><si:uncertainty>6e-7</si:uncertainty><si:coverageFactor>2</si:coverageFactor></si:expandedUnc></si:real></dcc:quantity>
</dcc:data></dcc:result></dcc:results></dcc:measurementResult></dcc:measurementResults></dcc:digitalCalibrationCertificate>)";

}  // namespace

Reader of_file(const Path& file, std::vector<std::string> examples, const std::function<void(const Path&)>& read) {
  return of_bytes(file.filename(), std::move(examples), [=](Bytes bytes) {
    std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
    read(file);
  });
}

std::vector<Reader> readers(const Path& folder) {
  std::vector<Reader> out;
  Capture capture = small_capture();
  write_capture(folder / "capture", capture);
  out.push_back(of_file(folder / "capture" / "capture.json", {read_bytes(folder / "capture" / "capture.json")},
                        [&](const Path& file) { read_capture_info(file.parent_path()); }));
  out.push_back(of_file(folder / "import_plan.toml", {text_of("tests/e2e/procam_gray.toml")},
                        [folder](const Path& file) { read_import_plan(file, folder); }));

  model::write_scanner(folder / "scanner.json", sample_scanner());
  out.push_back(of_file(folder / "scanner.json", {read_bytes(folder / "scanner.json")},
                        [](const Path& file) { model::read_scanner(file); }));
  const model::Scanner sample = sample_scanner();
  const calib::PlacedCamera placed{sample.camera, sample.proj_from_cam};
  out.push_back(of_file(folder / "camera.cameramodel", {calib::lens_file(placed, calib::LensFormat::mrcal, "by hand")},
                        [](const Path& file) { calib::read_lens_file(file); }));
  out.push_back(of_file(folder / "camera.yml", {calib::lens_file(placed, calib::LensFormat::opencv, "by hand")},
                        [](const Path& file) { calib::read_lens_file(file); }));
  hw::ScannerFile devices;
  devices.camera.address = "192.168.7.2";
  devices.plc_address = "modbus-tcp://192.168.7.3:502";
  devices.plan = capture.info.plan;
  out.push_back(
      of_file(folder / "scanner.toml", {hw::to_toml(devices)}, [](const Path& file) { hw::read_scanner_file(file); }));
  out.push_back(
      of_file(folder / "artefacts.toml", {gauge_text()}, [](const Path& file) { metrology::read_gauges(file); }));
  out.push_back(of_file(folder / "plan.toml",
                        {text_of("metrology/plans/paper.toml"), text_of("metrology/plans/quick.toml")},
                        [](const Path& file) { metrology::read_plan(file.string()); }));
  out.push_back(of_file(folder / "lab.toml", {text_of("reports/examples/lab.toml")},
                        [](const Path& file) { reports::read_laboratory(file); }));
  out.push_back(of_file(folder / "customer.toml", {text_of("reports/examples/customer.toml")},
                        [](const Path& file) { reports::read_customer(file); }));

  out.push_back(of_file(folder / "verification.json", {to_json(metrology::to_value(sample_verification()))},
                        [](const Path& file) { metrology::read_verification(file); }));
  out.push_back(of_file(folder / "history.db", {history_bytes(folder / "example.db")}, [](const Path& file) {
    const metrology::History history(file, metrology::History::Access::read);
    history.head();
    history.each([](const metrology::HistoryView&) {});
    history.check();
  }));
  out.push_back(of_file(folder / "board.toml",
                        {"kind = \"chessboard\"\ncolumns = 3\nrows = 3\npitch_mm = 10.0\nu_print_mm = 0.01\n"},
                        [](const Path& file) { model::read_board(file); }));
  out.push_back(of_file(folder / "corners.vnl",
                        {"# filename x y level\na.png 1.5 2.5 0\na.png 2 3 0\na.png - - -\na.png 4 5 1\n"
                         "a.png 5 6 -\na.png 6.25 7 0\nempty.png - - -\n"},
                        [](const Path& file) {
                          const std::vector<Eigen::Vector2d> places(6, Eigen::Vector2d::Zero());
                          calib::read_corners(std::vector{file}, places);
                        }));
  out.push_back(of_file(folder / "corners.txt", {"1 2  3 4 # two\n5 6\n"},
                        [](const Path& file) { calib::read_places(file, 1.0); }));
  out.push_back(of_file(folder / "scene.toml",
                        {"[[objects]]\nname = \"a\"\nkind = \"sphere\"\nposition_mm = [0, 0, 50]\n"
                         "rotation_deg = [0, 0, 0]\ndiameter_mm = 50\n"},
                        [](const Path& file) { virt::read_scene(file); }));

  metrology::PointCloud cloud;
  for (int i = 0; i < 4; ++i) cloud.points.push_back({.position_mm = {1.0 * i, 2.5, -3}, .u_along_ray_mm = 0.01});
  metrology::write_ply(folder / "cloud.ply", cloud);
  const std::string ply = read_bytes(folder / "cloud.ply");
  out.push_back(of_file(folder / "cloud.ply", {ply}, [](const Path& file) { metrology::read_ply(file); }));
  out.push_back(
      of_file(folder / "points.ply",
              {ply,
               "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
               "end_header\n1 2 3\n4 5 6\n"},
              [](const Path& file) { read_points_mm(file); }));
  out.push_back(of_file(folder / "points.xyz", {"1 2 3\n4.5 -6e-3 7\n", "1,2,3\r\n4,5,6\r\n"},
                        [](const Path& file) { read_points_mm(file); }));
  out.push_back(of_file(folder / "points.ds", {"2\n1 2 3\n4.5 -6e-3 7\n"},
                        [](const Path& file) { read_points_mm(file, LengthUnit::m); }));

  out.push_back(of_bytes("images",
                         {encode_png(GrayImage(Image8(7, 5, 100))), encode_png(GrayImage(Image16(7, 5, 40000))), bmp(),
                          "P5\n4 2\n255\nabcdefgh", "P5 # note\n2 2 4095\n\1\2\3\4\1\2\3\4"},
                         [](Bytes bytes) { decode_gray_image(bytes, "image"); }));
  out.push_back(of_file(folder / "map.tiff", {encode_tiff(Image<float>(6, 4, 1.5f))},
                        [](const Path& file) { read_float_tiff(file); }));

  out.push_back(of_bytes("DCC", {kDcc}, [](Bytes bytes) {
    reports::artefact_certificate(reports::XmlDocument::parse(std::string(bytes), "dcc.xml"), "dcc.xml");
  }));
  using hw::mewtocol::FrameKind;
  out.push_back(of_bytes(
      "MEWTOCOL",
      {hw::mewtocol::encode({1, FrameKind::answer, "RD63006400"}), hw::mewtocol::encode({1, FrameKind::refusal, "40"})},
      [](Bytes bytes) {
        const auto frame = hw::mewtocol::decode(bytes);
        if (frame.kind == FrameKind::refusal) {
          hw::mewtocol::refusal_words(frame.text);
        } else if (frame.text.size() > 2) {
          hw::mewtocol::words_from_hex(std::string_view(frame.text).substr(2));
        }
      }));
  out.push_back(of_bytes("addresses",
                         {"modbus-tcp://127.0.0.1:5020", "modbus-rtu:/dev/ttyUSB0?baud=115200&slave=1",
                          "mewtocol:/dev/ttyUSB0?baud=9600&station=1"},
                         [](Bytes bytes) { hw::parse_plc_address(std::string(bytes)); }));
  out.push_back(of_bytes("JSON", {R"({"a": [1, 2.5e3, null, "\u00e4"], "b": {"c": true}})"},
                         [](Bytes bytes) { parse_json(bytes, "json"); }));
  out.push_back(of_bytes("TOML", {"a = 1\nb = [1.5, 2]\n[c]\nd = 'x'\n[[e]]\nf = 2026-01-01\n"},
                         [](Bytes bytes) { parse_toml(bytes, "toml"); }));
  const std::vector<Reader> of_devices = device_readers();
  out.insert(out.end(), of_devices.begin(), of_devices.end());
  return out;
}

std::string damaged(std::string bytes, std::uint64_t number) {
  std::mt19937_64 random(number);
  const auto below = [&](std::size_t n) { return n == 0 ? 0 : static_cast<std::size_t>(random() % n); };
  static const std::string kPieces[] = {"-1",
                                        "0",
                                        "999999999999999999999",
                                        "1e999",
                                        "-1e-999",
                                        "nan",
                                        "\"",
                                        "[",
                                        "]]",
                                        "{",
                                        "}",
                                        "\n",
                                        "\r",
                                        ",",
                                        "=",
                                        "<",
                                        "</a>",
                                        "&#0;",
                                        "\xff\xfe",
                                        "%",
                                        "**",
                                        "4294967295",
                                        "2147483648",
                                        "65536",
                                        std::string("\0\0\0\0", 4),
                                        std::string("\xff\xff\xff\xff", 4),
                                        std::string("\x7f\xff\xff\xff", 4)};
  const std::size_t places = 1 + below(4);
  for (std::size_t k = 0; k < places; ++k) {
    const std::size_t at = below(bytes.size() + 1), length = below(std::min<std::size_t>(bytes.size() - at, 40) + 1);
    switch (below(8)) {
      case 0:
        if (at < bytes.size()) bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
        break;
      case 1:
        if (at < bytes.size()) bytes[at] = static_cast<char>(random());
        break;
      case 2:
        bytes.erase(at, length);
        break;
      case 3:
        bytes.insert(below(bytes.size() + 1), bytes.substr(at, length));
        break;
      case 4:
        bytes.resize(at);
        break;
      case 5:
        bytes.insert(at, kPieces[below(std::size(kPieces))]);
        break;
      case 6:
        bytes.replace(at, length, kPieces[below(std::size(kPieces))]);
        break;
      default: {  // a number becomes another
        const std::size_t digit = bytes.find_first_of("0123456789", at);
        if (digit == std::string::npos) break;
        const std::size_t end = std::min(bytes.find_first_not_of("0123456789.eE+-", digit), bytes.size());
        bytes.replace(digit, end - digit, kPieces[below(6)]);
      }
    }
  }
  return bytes;
}

}  // namespace fringecal::test
