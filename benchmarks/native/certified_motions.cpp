#include "certified_motions.hpp"

#include <cmath>
#include <ompl/base/spaces/SE2StateSpace.h>
#include <queue>

namespace trailmark {
namespace {

namespace ob = ompl::base;
using SE2 = ob::SE2StateSpace;

constexpr double kPi = 3.14159265358979323846;
constexpr double kShortest = 1e-6;        // metres of motion; what is not certified within is refused: it slides along a wall
constexpr unsigned kMostStates = 10000;   // of one motion; as above
constexpr double kRounding = 1.0 + 1e-9;  // of the length of a motion, and of the states on it

// A part of a motion, by its ends' parameters and clearances.
struct Part {
  double from, to, from_clearance, to_clearance;
};

}  // namespace

CertifiedMotions::CertifiedMotions(const ob::SpaceInformationPtr& information, const Checker& checker,
                                   const Robot& robot)
    : ob::MotionValidator(information),
      checker_(checker),
      turning_radius_(robot.turning_radius),
      reach_(robot.round ? 0.0 : robot.circumradius) {}

bool CertifiedMotions::checkMotion(const ob::State* a, const ob::State* b) const {
  const bool free = certified(a, b);
  ++(free ? valid_ : invalid_);
  return free;
}

bool CertifiedMotions::checkMotion(const ob::State* a, const ob::State* b,
                                   std::pair<ob::State*, double>& last_valid) const {
  const bool free = checkMotion(a, b);
  if (!free) {
    last_valid.second = 0.0;
    if (last_valid.first != nullptr) {
      si_->copyState(last_valid.first, a);
    }
  }
  return free;
}

double CertifiedMotions::clearance(const ob::State* state) const {
  const auto* q = state->as<SE2::StateType>();
  return checker_.clearance(q->getX(), q->getY(), q->getYaw());
}

// No point of the robot moves farther than this (metres). A car turns by a radian while it drives its turning radius.
double CertifiedMotions::reach(const ob::State* a, const ob::State* b) const {
  if (turning_radius_ > 0.0) {
    return kRounding * si_->distance(a, b) * (1.0 + reach_ / turning_radius_);
  }
  const auto *p = a->as<SE2::StateType>(), *q = b->as<SE2::StateType>();
  const double turn = std::abs(std::remainder(q->getYaw() - p->getYaw(), 2.0 * kPi));
  return kRounding * (std::hypot(q->getX() - p->getX(), q->getY() - p->getY()) + reach_ * turn);
}

// A state with clearance d certifies all of the motion within d of it. What is left is cut in its middle, breadth first, so
// that collisions are found soon.
bool CertifiedMotions::certified(const ob::State* a, const ob::State* b) const {
  const double whole = reach(a, b), at_end = clearance(b);
  if (!(at_end > 0.0)) {
    return false;
  }
  const double at_start = clearance(a);
  if (!(at_start > 0.0)) {
    return false;
  }
  std::queue<Part> parts;
  parts.push({0.0, 1.0, at_start, at_end});
  ob::State* middle = si_->allocState();
  bool free = true;
  for (unsigned states = 0; free && !parts.empty(); parts.pop()) {
    const Part part = parts.front();
    const double length = (part.to - part.from) * whole;
    if (part.from_clearance + part.to_clearance >= length) {
      continue;
    }
    // The middle of what the ends do not certify.
    const double at = 0.5 * (part.from + part.to + (part.from_clearance - part.to_clearance) / whole);
    si_->getStateSpace()->interpolate(a, b, at, middle);
    const double found = clearance(middle);
    free = found > 0.0 && length > kShortest && ++states < kMostStates;
    parts.push({part.from, at, part.from_clearance, found});
    parts.push({at, part.to, found, part.to_clearance});
  }
  si_->freeState(middle);
  return free;
}

}  // namespace trailmark
