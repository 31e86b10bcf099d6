// Problem: what to plan in, with what, from where to where, as trailmark.benchmark.export writes it.
#pragma once

#include <array>
#include <istream>
#include <vector>

namespace trailmark {

using Point = std::array<double, 2>;           // metres
using Triangle = std::array<Point, 3>;         // metres
using Configuration = std::array<double, 3>;   // x, y (metres), theta (radians)

struct Disc {
  Point center;    // metres
  double radius;   // metres
};

// The robot in its own frame, whose origin is the reference point that a configuration places.
struct Robot {
  bool round;                       // a disc about the reference point
  double radius;                    // of that disc less the touching tolerance; 0 for other footprints
  std::vector<Triangle> triangles;  // fill other footprints, eroded by at most the touching tolerance
  std::vector<Point> hull;          // corners of the footprint's convex hull; empty for a disc
  double circumradius;              // largest distance of the footprint from the reference point
  Disc inscribed;                   // a disc inside the eroded footprint
  double turning_radius;            // of a car, metres; 0 for a robot that moves straight in every direction
  bool reverse;                     // whether the car drives backwards too
};

struct Problem {
  std::array<double, 4> bounds;     // xmin, ymin, xmax, ymax; no part of the robot may leave it
  double tolerance;                 // overlap (metres) with the bounds up to which the robot only touches them
  std::vector<Triangle> triangles;  // all polygons, and what lies outside the boundary
  std::vector<Disc> discs;
  Robot robot;
  Configuration start;
  Configuration goal;
};

// Returns the problem in a stream of JSON. Throws std::runtime_error, whose text says in one line what is wrong.
Problem read_problem(std::istream& stream);

}  // namespace trailmark
