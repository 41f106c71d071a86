BEGIN TRANSACTION;
CREATE TABLE calibrations (
	calibration_id TEXT NOT NULL, 
	content TEXT NOT NULL, 
	PRIMARY KEY (calibration_id)
);
INSERT INTO "calibrations" VALUES('ebd5e507e4b6b445','{"format": "palpate-calibration"}');
CREATE TABLE grasps (
	number INTEGER NOT NULL, 
	grasp_id TEXT NOT NULL, 
	item_id TEXT NOT NULL, 
	taken_at TEXT NOT NULL, 
	rig TEXT NOT NULL, 
	drive TEXT NOT NULL, 
	origin TEXT NOT NULL, 
	outcome TEXT NOT NULL, 
	decision_time_s DOUBLE PRECISION, 
	peak_force_n DOUBLE PRECISION, 
	angle_deg DOUBLE PRECISION, 
	height_mm DOUBLE PRECISION, 
	temperature_c DOUBLE PRECISION, 
	humidity_percent DOUBLE PRECISION, 
	calibration_id TEXT, 
	recording TEXT, 
	pixel_settled_percent JSON, 
	station TEXT, 
	firmness_force_n DOUBLE PRECISION, 
	PRIMARY KEY (number), 
	UNIQUE (grasp_id), 
	FOREIGN KEY(item_id) REFERENCES items (item_id), 
	FOREIGN KEY(calibration_id) REFERENCES calibrations (calibration_id)
);
INSERT INTO "grasps" VALUES(1,'7b0c4a52-9a3e-4c56-8a0e-0d6a2f1f4b11','A17','2026-05-01T08:30:00.123456Z','hall.toml','width','hardware','held',1.25,4.5,90.0,-3.0,21.5,45.0,'ebd5e507e4b6b445','runs/17.mcap','[[-40.0, null], [-43.25, -41.0]]','line 1',2.0);
CREATE TABLE items (
	item_id TEXT NOT NULL, 
	kind TEXT, 
	batch TEXT, 
	label TEXT, 
	first_seen TEXT NOT NULL, 
	PRIMARY KEY (item_id)
);
INSERT INTO "items" VALUES('A17','avocado','Monday','the dark one','2026-05-01T08:30:00.123456Z');
CREATE TABLE measurements (
	grasp_number BIGINT NOT NULL, 
	name TEXT NOT NULL, 
	value DOUBLE PRECISION, 
	low DOUBLE PRECISION, 
	high DOUBLE PRECISION, 
	level DOUBLE PRECISION NOT NULL, 
	status TEXT NOT NULL, 
	PRIMARY KEY (grasp_number, name), 
	FOREIGN KEY(grasp_number) REFERENCES grasps (number)
)
 WITHOUT ROWID

;
INSERT INTO "measurements" VALUES(1,'force_n',NULL,4.0,NULL,0.9,'at_least');
INSERT INTO "measurements" VALUES(1,'size_mm',62.5,62.0,63.0,0.95,'fell_back');
INSERT INTO "measurements" VALUES(1,'stiffness_n_per_mm',3.5,3.0,4.25,0.9,'ok');
CREATE TABLE outbox (
	number INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT, 
	receiver TEXT NOT NULL, 
	kind TEXT NOT NULL, 
	content TEXT NOT NULL
);
CREATE TABLE palpate_schema (
	version INTEGER NOT NULL, 
	applied_at TEXT NOT NULL, 
	PRIMARY KEY (version)
);
INSERT INTO "palpate_schema" VALUES(5,'2026-12-01T13:36:59.659769Z');
CREATE TABLE verdicts (
	verdict_id TEXT NOT NULL, 
	item_id TEXT NOT NULL, 
	grasp_id TEXT, 
	about TEXT NOT NULL, 
	source TEXT NOT NULL, 
	text TEXT NOT NULL, 
	probability DOUBLE PRECISION, 
	explanation TEXT NOT NULL, 
	details JSON NOT NULL, 
	given_at TEXT NOT NULL, 
	PRIMARY KEY (verdict_id), 
	FOREIGN KEY(item_id) REFERENCES items (item_id), 
	FOREIGN KEY(grasp_id) REFERENCES grasps (grasp_id)
);
INSERT INTO "verdicts" VALUES('0f4a9d3c-2d11-4a4e-b6fb-2f3a5c9f2e77','A17','7b0c4a52-9a3e-4c56-8a0e-0d6a2f1f4b11','ripeness','palpate','ripe',0.875,'softer than on Friday','{"days_to_ripe": 0.5}','2026-05-01T08:30:00.123456Z');
INSERT INTO "verdicts" VALUES('5a7b7e0e-6f36-4b0e-9a53-2b0f64d2a1c9','A17',NULL,'ripeness','person','overripe',NULL,'','{}','2026-05-01T09:30:00.123456Z');
CREATE INDEX items_by_kind ON items (kind, first_seen);
CREATE INDEX items_by_batch ON items (batch, first_seen);
CREATE INDEX items_by_time ON items (first_seen);
CREATE INDEX grasps_by_time ON grasps (taken_at);
CREATE INDEX grasps_by_item ON grasps (item_id, taken_at);
CREATE INDEX verdicts_by_item ON verdicts (item_id, given_at);
CREATE INDEX verdicts_by_subject ON verdicts (about, source, given_at);
DELETE FROM "sqlite_sequence";
COMMIT;
