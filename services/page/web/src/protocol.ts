// The messages between the page and its server; docs/page.md describes them. Lengths in m, forces in N, times in s.

export type Point = [number, number, number];

export interface Cycle { number: number; hz: number; summary: string; unsteered: number; missed: number; all: number }

export interface Mission {
    state: string; name: string; leg: number; legs: number; progress: number; time_left_s: number | null; reason: string; reason_code: number;
    target_m: (number | null)[];
    /** Time without a status of the planner, s; null: it publishes. */
    silent_s: number | null;
}

/** The state that changes all the time; what is not known is absent or null. */
export interface State {
    type: "state";
    /** Time of the server, ms. */
    at_ms: number;
    /** Time since motor-io published. */
    age_s: number | null;
    mode: string | null;
    mode_sentence?: string;
    faults?: string[];
    position?: string;
    position_known?: number;
    /** Whether it is known where the node is, or that it is not known. */
    located?: boolean;
    rate?: number;
    rate_target?: number;
    cycle?: Cycle;
    lengths_m?: number[];
    currents_a?: number[];
    supply_v?: number | null;
    position_m?: Point;
    within_m?: number | null;
    two_sigma_m?: (number | null)[];
    tensions_n?: (number | null)[];
    slack?: number[];
    mission?: Mission;
}

export interface Obstacle { center_m: [number, number] | null; radius_m: number | null; corners_m: [number, number][]; height_m: [number, number] }

/** A port with drives, and what to set in their maker's program. */
export interface Port { number: number; family: string; virtual: boolean; path: string; units: { address: number; cables: number[] }[]; set: string; silent: string; fastest_counts_s: number }

export interface Scene {
    type: "scene"; system: string; robot: string; anchors_m: Point[]; ground_m: number; planar: boolean;
    tension_limits_n: [number, number]; speed_limit_m_s: number; jog_speed_m_s: number; supply_min_v: number;
    keep_out_m: [Point, Point][]; obstacles: Obstacle[]; laws: Record<string, string[]>; plugins: string[]; drives: Port[];
    /** SHA-256 of the robot file with which it flies. */
    robot_file: string;
}

export interface Process { name: string; state: string; pid: number; restarts: number; role: string; reason: string; well: boolean }
export interface Slot { slot: string; phase: string; cause: string; in_charge: boolean; good_cycles: number; qualify_cycles: number; deviation: number | null; failures: number }

/** What a drive unit answers. */
export interface Unit { answers: boolean; supply_v: number }

/** The state that changes rarely. */
export interface Robot {
    type: "robot"; processes: Process[]; recorder: { problem: string | null; silent_s: number | null; bytes: number | null; disk_free_bytes: number | null } | null;
    flyer: { name: string; ago_s: number } | null; slots: Record<string, Slot[]> | null; units: Unit[] | null; sensors: string[]; version: string | null; unknown_channels: string[];
}

export interface Plan { type: "plan"; segments: { id: number; points_m: Point[] }[] }
export interface Link { type: "link"; gateway: boolean; robot: string | null; run?: string | null; sentence?: string }
export interface Welcome { type: "welcome"; robot: string; user: string; role: string; paired: boolean; sentence: string | null; version: string }
export interface Unreachable { type: "unreachable"; sentence: string }
export interface Log { type: "log"; at_ms: number; stamp_ns: number; process: string; level: "info" | "warning" | "error"; sentence: string }
/** Another controller or estimator is in charge. */
export interface Swapped { type: "swap"; at_ms: number; stamp_ns: number; role: string; slot: string }
export interface Asked { type: "request"; at_ms: number; stamp_ns: number; who: string; accepted: boolean; reason: number; sentence: string }

/** The figures of the charts. */
export interface Figures { mode: string | null; position_m: (number | null)[]; within_m: number | null; tensions_n: (number | null)[]; currents_a: (number | null)[]; supply_v: number | null }
/** The last ten minutes, each row with its age. */
export interface History { type: "history"; rows: [number, Figures][] }

export type Told = History | State | Scene | Robot | Plan | Link | Welcome | Unreachable | Log | Asked | Swapped;

export interface Answer { reply: "answer"; id: number; accepted: "accepted" | "refused" | "bad-input"; reason: number; sentence: string }
export interface Checked { reply: "check"; id: number; possible: boolean; sentence: string }
export interface RunRow { name: string; files: number; bytes: number }
export interface FileRow { name: string; bytes: number }
export interface Runs { reply: "runs"; id: number; runs: RunRow[]; disk?: { total: number; free: number; quota?: number } }
export interface Files { reply: "files"; id: number; files: FileRow[] }
export interface Download { reply: "download"; id: number; path: string; bytes: number }
/** Who flies and who asks to, told whenever it changes. */
export interface Seat { reply: "seat"; id: number; flyer: string | null; asks: string | null; within_s: number }
export interface Done { reply: "done"; id: number }
export interface Token { reply: "token"; id: number; secret: string }
/** The open question of the guided calibration, for its drawing. */
export interface Open { kind: string; from?: number; to?: number; pulley?: number; place?: number; cable?: number; optional?: boolean; weight?: boolean }
/** The site from above. */
export interface SiteMap {
    anchors_m: Point[]; known: { half_axes_m: [number, number]; angle_rad: number; height_std_m: number }[]; points_m: [number, number][];
    next_m: [number, number] | null; best: { at_m: [number, number]; worst_std_m: [number, number] } | null;
}
export interface TextFile { name: string; text: string }
/** `made_from`: SHA-256 of the robot file from which this one was made. */
export interface RobotFile extends TextFile { made_from: string }
/** What follows from an answer of the guided calibration, or of the measurements with a weight, which have no map and a name. */
export interface Stepped {
    reply: "setup"; id: number; message: string; changed: boolean; question: string; open: Open; measurements: string; name?: string; map: SiteMap | null;
    finished: { words: string; calibration: TextFile | null; robot: RobotFile | null } | null;
}
/** The names of all numbers by channel, and the values of one. */
export interface Fields { reply: "fields"; id: number; channels: Record<string, string[]> }
export interface Series { reply: "series"; id: number; at_ms: number[]; values: (number | null)[] }
export interface Finding { level: string; finding: string; cure: string }
export interface Findings { reply: "findings"; id: number; findings: Finding[] }
export type Reply = Findings | Fields | Series | Stepped | Answer | Checked | Runs | Files | Download | Seat | Done | Token;

export type Request =
    | { verb: "arm" | "disarm" | "hold" | "stop" | "estop" | "reset" | "confirm-position" | "pause" | "resume" }
    | { verb: "zero-at"; position_m: Point }
    | { verb: "jog"; cable: number; distance_m: number }
    | { verb: "speed"; rate: number }
    | { verb: "goto"; to_m: Point; path: { shape: "line" }; speed_m_s: number | null }
    | { verb: "start-process"; name: string; slot: string | null; law: string | null }
    | { verb: "swap" | "admit"; role: string; slot: string }
    | { verb: "stop-process" | "restart-process" | "unplug"; name: string };

/** When a sign that a control is held was made, and of when the robot is that could be seen, ms in time of the server. */
export interface Sign { made_ms: number; seen_ms: number }

/** A call, to which the link adds its number; `press`: that of the press, which all attempts of it have. */
export type Call =
    | { call: "ask"; request: Request; press: number | null }
    | { call: "held"; request: Request; sign: Sign; press: number | null }
    | { call: "fly"; name: string; text: string; continues: boolean }
    | { call: "pair"; code: string }
    | { call: "seat"; what: "ask" | "give" | "keep" }
    | { call: "check"; to_m: Point }
    | { call: "setup"; name: string; measurements: string; line: string | null }
    | { call: "weigh"; measurements: string; line: string | null; after_ms: number | null }
    | { call: "runs" }
    | { call: "files"; run: string }
    | { call: "open"; run: string; file: string; show: boolean }
    | { call: "make"; run: string; what: "report" | "maps" | "csv" | "parquet" }
    | { call: "remove"; run: string }
    | { call: "doctor" }
    | { call: "robot-file"; robot: string; calibration: string | null; made_from: string }
    | { call: "fields" }
    | { call: "series"; channel: string; field: string; after_ms: number };
