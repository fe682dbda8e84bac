// What is behind each path. GET reads; POST starts or stops the job, and nothing else changes anything.
#pragma once

#include "cli/serve/gate.h"
#include "cli/serve/http.h"
#include "cli/serve/jobs.h"
#include "cli/serve/live_feed.h"
#include "cli/serve/state_feed.h"
#include "cli/serve/workbench.h"

namespace fringecal::cli::serve {

struct Rooms {
  Gate& gate;
  Workbench& workbench;
  Jobs& jobs;
  StateFeed& feed;
  LiveFeed& live;
};

/// The answer to a request that has passed the gate. Input that cannot be used is 422 with its sentence.
HttpResponse answer(const HttpRequest& request, Rooms rooms);

}  // namespace fringecal::cli::serve
