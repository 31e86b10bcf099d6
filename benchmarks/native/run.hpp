// One run of one planner on one problem, measured.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "checker.hpp"
#include "problem.hpp"

namespace trailmark {

struct Settings {
  std::string planner = "RRTConnect";
  double resolution = 0.1;      // metres between the states that OMPL's discrete motion validator looks at
  bool certified = false;       // motions by CertifiedMotions instead, which has no resolution
  double settle = 0.02;         // seconds of planning that nothing measures, before that which is measured
  double time_limit = 1.0;      // seconds
  double simplify_limit = 0.5;  // seconds
  double memory_limit = 0.0;    // MB above what is mapped when planning begins; 0: none
  double cost_threshold = 0.0;  // metres; a solution below ends the planning
  unsigned seed = 1;            // above 0, as OMPL asks
  std::vector<std::pair<std::string, std::string>> parameters;  // of the planner, by OMPL's names
};

// Returns the fields of trailmark.benchmark.record.RunRecord, set-up time left out.
// Throws std::runtime_error for a planner that is not there, or a parameter that it does not have.
nlohmann::json run(const Problem& problem, const Checker& checker, const Settings& settings);

// Returns for each motion, whose ends follow one another, 1 if it is certified free, else 0.
std::string certified(const Problem& problem, const Checker& checker, const std::vector<Configuration>& ends);

}  // namespace trailmark
