// OMPL's C++ planners on one problem of trailmark's, with FCL in C++.
//
//   trailmark_native planners                        names and versions
//   trailmark_native plan  PLANNER [OPTION VALUE]... problem on standard input
//   trailmark_native check FILE [plain]           problem on standard input; FILE holds rows "x y theta"
//   trailmark_native certify FILE                 the same; FILE's rows are the ends of motions by turns
//
// PLANNER+certified plans with certified motions. Options of plan: --settle SECONDS --resolution METRES --time-limit SECONDS --simplify-limit SECONDS --memory-limit MB
// --cost-threshold METRES --seed N --parameter NAME=VALUE (as often as need be).
// The answer is one JSON object on standard output. Bad input: one line on standard error, status 2.

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <ompl/config.h>
#include <stdexcept>
#include <string>
#include <vector>

#include "checker.hpp"
#include "planners.hpp"
#include "problem.hpp"
#include "run.hpp"

namespace {

using Json = nlohmann::json;
using Words = std::vector<std::string>;
using Kind = trailmark::Checker::Kind;

const std::string kCertified = "+certified";

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

double positive(const std::string& option, const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !(value > 0.0 && value < 1e12)) {
    throw std::runtime_error(option + " " + text + " given, allowed: a number above 0");
  }
  return value;
}

trailmark::Settings settings_of(const Words& words) {
  trailmark::Settings settings;
  settings.planner = words.at(0);
  const std::size_t name = settings.planner.size() - std::min(settings.planner.size(), kCertified.size());
  if (settings.planner.substr(name) == kCertified) {
    settings.planner.resize(name);
    settings.certified = true;
  }
  for (std::size_t i = 1; i < words.size(); i += 2) {
    const std::string& option = words[i];
    if (i + 1 == words.size()) {
      throw std::runtime_error(option + " given without a value");
    }
    if (option == "--parameter") {
      const std::size_t equals = words[i + 1].find('=');
      if (equals == std::string::npos) {
        throw std::runtime_error(option + " " + words[i + 1] + " given, allowed: NAME=VALUE");
      }
      settings.parameters.emplace_back(words[i + 1].substr(0, equals), words[i + 1].substr(equals + 1));
      continue;
    }
    const double value = positive(option, words[i + 1]);
    if (option == "--resolution") {
      settings.resolution = value;
    } else if (option == "--settle") {
      settings.settle = value;
    } else if (option == "--time-limit") {
      settings.time_limit = value;
    } else if (option == "--simplify-limit") {
      settings.simplify_limit = value;
    } else if (option == "--memory-limit") {
      settings.memory_limit = value;
    } else if (option == "--cost-threshold") {
      settings.cost_threshold = value;
    } else if (option == "--seed" && value < 4294967296.0) {
      settings.seed = static_cast<unsigned>(value);
    } else {
      throw std::runtime_error(option + " " + words[i + 1] + " given, allowed: --resolution, --settle, --time-limit, " +
                               "--simplify-limit, --memory-limit, --cost-threshold, --parameter, --seed (below 2^32)");
    }
  }
  return settings;
}

Json planners() {
  Json parameters = Json::object();
  for (const std::string& name : trailmark::planner_names()) {
    parameters[name] = trailmark::parameter_names(name);
  }
  return {{"planners", trailmark::planner_names()},
          {"parameters", parameters},
          {"ompl", OMPL_VERSION_TEXT},
          {"fcl", FCL_VERSION_TEXT}};
}

Json plan(const Words& words) {
  const trailmark::Settings settings = settings_of(words);
  const auto begin = std::chrono::steady_clock::now();
  const trailmark::Problem problem = trailmark::read_problem(std::cin);
  const trailmark::Checker checker(problem, settings.certified ? Kind::kClearances : Kind::kFast);
  const double setup = seconds_since(begin);
  Json record = trailmark::run(problem, checker, settings);
  record["setup_time"] = setup;
  return record;
}

std::vector<trailmark::Configuration> read_states(const std::string& name) {
  std::ifstream file(name);
  if (!file) {
    throw std::runtime_error("states: " + name + " cannot be read");
  }
  std::vector<trailmark::Configuration> states;
  for (trailmark::Configuration q; file >> q[0] >> q[1] >> q[2];) {
    states.push_back(q);
  }
  return states;
}

Json check(const Words& words) {
  const trailmark::Problem problem = trailmark::read_problem(std::cin);
  const trailmark::Checker checker(problem, words.size() > 1 && words[1] == "plain" ? Kind::kPlain : Kind::kFast);
  const std::vector<trailmark::Configuration> states = read_states(words.at(0));
  std::string answers(states.size(), '0');
  const auto begin = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < states.size(); ++i) {
    answers[i] = checker.valid(states[i][0], states[i][1], states[i][2]) ? '1' : '0';
  }
  const double elapsed = seconds_since(begin);
  return {{"valid", answers}, {"seconds_per_check", states.empty() ? 0.0 : elapsed / states.size()}};
}

Json certify(const Words& words) {
  const trailmark::Problem problem = trailmark::read_problem(std::cin);
  const trailmark::Checker checker(problem, Kind::kClearances);
  const std::vector<trailmark::Configuration> states = read_states(words.at(0));
  std::vector<double> clearances;
  for (const auto& q : states) {
    clearances.push_back(checker.clearance(q[0], q[1], q[2]));
  }
  const auto begin = std::chrono::steady_clock::now();
  const std::string answers = trailmark::certified(problem, checker, states);
  const double elapsed = seconds_since(begin);
  return {{"free", answers},
          {"clearances", clearances},
          {"seconds_per_motion", answers.empty() ? 0.0 : elapsed / static_cast<double>(answers.size())}};
}

Json answer(const Words& words) {
  if (words.size() == 1 && words[0] == "planners") {
    return planners();
  }
  if (words.size() >= 2 && words[0] == "plan") {
    return plan({words.begin() + 1, words.end()});
  }
  if (words.size() >= 2 && words[0] == "check") {
    return check({words.begin() + 1, words.end()});
  }
  if (words.size() == 2 && words[0] == "certify") {
    return certify({words[1]});
  }
  throw std::runtime_error("arguments: allowed are planners, plan PLANNER [OPTION VALUE]..., check FILE [plain], certify FILE");
}

}  // namespace

int main(int count, char** values) {
  try {
    std::ios::sync_with_stdio(false);
    std::cout << answer({values + 1, values + count}).dump() << std::endl;
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "trailmark_native: " << error.what() << std::endl;
    return 2;
  }
}
