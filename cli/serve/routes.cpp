#include "cli/serve/routes.h"

#include "cli/serve/pages.h"
#include "core/error.h"
#include "core/file.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

namespace fringecal::cli::serve {
namespace {

HttpResponse json(const Value& value) { return {.body = to_json(value)}; }

HttpResponse binary(const std::filesystem::path& file) {
  return {.type = "application/octet-stream", .body = read_bytes(file)};
}

HttpResponse refused(int status, const std::string& sentence) {
  return {.status = status, .body = to_json(Value::object().set("sentence", sentence))};
}

std::string asked(const HttpRequest& request, const char* key) {
  const auto found = request.query.find(key);
  if (found == request.query.end()) throw InputError(fmt::format("the request says no {}", key));
  return found->second;
}

std::int64_t number(const std::string& text) {
  std::int64_t out = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  if (error != std::errc() || end != text.data() + text.size())
    throw InputError(fmt::format("\"{}\" is no number", text));
  return out;
}

/// A document that a command wrote: its styles and pictures are inside it, it runs nothing and asks for nothing.
HttpResponse document(const std::filesystem::path& file, const char* type) {
  return {.type = type,
          .body = read_bytes(file),
          .headers = {
              {"Content-Security-Policy", "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"}}};
}

std::optional<HttpResponse> page(const std::string& path) {
  const std::string name = path == "/" ? "/index.html" : path == "/sign-in" ? "/sign-in.html" : path;
  for (const Page& one : pages()) {
    if (one.path == name) return HttpResponse{.type = std::string(one.type), .body = std::string(one.content)};
  }
  const auto module = three_file(path);
  if (!module) return std::nullopt;
  if (!std::filesystem::exists(*module)) return HttpResponse{.status = 404};
  return HttpResponse{.type = "text/javascript; charset=utf-8", .body = read_bytes(*module)};
}

HttpResponse get(const HttpRequest& request, Rooms r) {
  const std::string& path = request.path;
  if (auto found = page(path)) return *found;
  if (path == "/api/state") return {.body = r.feed.state()};
  if (path == "/api/events") return {.events = r.feed.events()};
  if (path == "/api/live") return {.events = r.live.events()};
  if (path == "/api/alignment") return json(r.workbench.alignment());
  if (path == "/api/calibration") return json(r.workbench.calibration());
  if (path == "/api/calibration/map") return json(r.workbench.calibration_map());
  if (path == "/api/calibration/picture") {
    return json(r.workbench.calibration_picture(
        static_cast<int>(std::clamp<std::int64_t>(number(asked(request, "pose")), 0, 99))));
  }
  if (path == "/api/verification") return json(r.workbench.verification(asked(request, "name")));
  if (path == "/api/verification/space") return json(r.workbench.verification_space(asked(request, "name")));
  if (path == "/api/verification/cloud") {
    return binary(r.workbench.verification_cloud(asked(request, "name"), asked(request, "cloud")));
  }
  if (path == "/api/plans") return json(r.workbench.plans());
  if (path == "/api/history") return json(r.workbench.history_list());
  if (path == "/api/history/entry") return json(r.workbench.history_entry(number(asked(request, "number"))));
  if (path == "/api/history/chart") {
    return json(r.workbench.history_chart(asked(request, "symbol"), asked(request, "artefact")));
  }
  if (path == "/api/clouds") return json(r.workbench.clouds());
  if (path == "/api/cloud") return binary(r.workbench.cloud_file(asked(request, "name")));
  if (path == "/api/certificates") return json(r.workbench.certificates());
  if (path == "/certificate") {
    return document(r.workbench.certificate_file(asked(request, "folder"), asked(request, "file")),
                    "application/octet-stream");
  }
  if (path == "/report.html") return document(r.workbench.commissioning() / "report.html", "text/html; charset=utf-8");
  return refused(404, "There is nothing at this address.");
}

HttpResponse post(const HttpRequest& request, Rooms r) {
  const Value body = parse_json(request.body, "the page's request");
  if (request.path == "/sign-in") {
    const Value* password = body.find("password");
    return r.gate.sign_in(password && password->if_text() ? *password->if_text() : "");
  }
  if (request.path == "/api/job/start") {
    const auto words = r.workbench.command(body);
    bool started = false;
    if (!r.jobs.running()) r.live.give_way([&] { started = r.jobs.start(words); });  // the job needs the camera
    if (!started) return refused(409, "A job is running on this folder already; wait for its end or stop it.");
    return {.status = 202, .body = to_json(r.jobs.state())};
  }
  if (request.path == "/api/job/stop") {
    return r.jobs.stop() ? HttpResponse{.status = 202, .body = "{}\n"} : refused(409, "No job is running.");
  }
  return refused(404, "There is nothing at this address.");
}

}  // namespace

HttpResponse answer(const HttpRequest& request, Rooms rooms) {
  try {
    return request.method == "POST" ? post(request, rooms) : get(request, rooms);
  } catch (const InputError& e) {
    return refused(422, e.what());
  } catch (const EnvironmentError& e) {
    return refused(503, e.what());
  }
}

}  // namespace fringecal::cli::serve
