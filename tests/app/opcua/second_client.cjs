// A client of another code base (node-opcua-client) at counterflex's OPC UA server. Prints one JSON object and ends.
//
//     NODE_PATH=.../node_modules node second_client.cjs ADDRESS USER PASSWORD
"use strict";
const {
  AttributeIds, DataType, MessageSecurityMode, OPCUAClient, SecurityPolicy, UserTokenType, constructEventFilter,
  TimestampsToReturn,
} = require("node-opcua-client");

const [address, userName, password] = process.argv.slice(2);
const SPACE = "urn:counterflex:opcua";
const PATIENCE_MS = 60000;

async function main() {
  const client = OPCUAClient.create({
    endpointMustExist: false, securityMode: MessageSecurityMode.None, securityPolicy: SecurityPolicy.None,
    connectionStrategy: { maxRetry: 0 },
  });
  await client.connect(address);
  const endpoints = await client.getEndpoints();
  const session = await client.createSession({ type: UserTokenType.UserName, userName, password });
  const index = (await session.readNamespaceArray()).indexOf(SPACE);
  const id = (path) => `ns=${index};s=${path}`;
  const read = async (path) => {
    const one = await session.read({ nodeId: id(path), attributeId: AttributeIds.Value });
    return { status: one.statusCode.name, value: one.value.value, type: DataType[one.value.dataType] };
  };
  const until = async (path, wanted) => {
    const end = Date.now() + PATIENCE_MS;
    for (;;) {
      const seen = await read(path);
      if (wanted(seen)) return seen;
      if (Date.now() > end) throw new Error(`${path} stays ${JSON.stringify(seen)}`);
      await new Promise((done) => setTimeout(done, 50));
    }
  };
  const found = { endpoints: endpoints.map((one) => String(one.securityPolicyUri)), index };
  found.state = await until("Counterflex/State/State", (seen) => seen.value === "ACTIVE");
  found.force = await until("Counterflex/Force/MeasuredSize", (seen) => Math.abs(seen.value - 300) < 5);
  found.axes = [];
  for (let k = 1; k <= 6; k++) {
    found.axes.push(await read(`MotionDeviceSystem/MotionDevices/Robot/Axes/Axis_${k}/ParameterSet/ActualPosition`));
  }
  found.tracker = await read("Counterflex/Deviation/MeasuredAcross");
  const unit = (await read("Counterflex/Force/MeasuredSize/EngineeringUnits")).value;
  found.unit = { id: unit.unitId, name: unit.displayName.text };
  const below = await session.browse({
    nodeId: id("Counterflex"), referenceTypeId: "HierarchicalReferences", includeSubtypes: true, browseDirection: 0,
    nodeClassMask: 0, resultMask: 63,
  });
  found.below = below.references.map((one) => one.browseName.name);
  const status = await session.write({
    nodeId: id("Counterflex/State/State"), attributeId: AttributeIds.Value,
    value: { value: { dataType: DataType.String, value: "IDLE" } },
  });
  found.write = status.name;
  const called = await session.call({ objectId: id("Counterflex"), methodId: id("Counterflex/Acknowledge"), inputArguments: [] });
  found.call = called.statusCode.name;
  const subscription = await session.createSubscription2({
    requestedPublishingInterval: 50, requestedLifetimeCount: 1000, requestedMaxKeepAliveCount: 20,
    maxNotificationsPerPublish: 100, publishingEnabled: true, priority: 1,
  });
  const states = await subscription.monitor(
    { nodeId: id("Counterflex/State/State"), attributeId: AttributeIds.Value },
    { samplingInterval: 50, discardOldest: false, queueSize: 50 }, TimestampsToReturn.Both,
  );
  found.changes = [];
  states.on("changed", (one) => found.changes.push(one.value.value));
  const filter = constructEventFilter(["Message", "Severity"]);
  const events = await subscription.monitor(
    { nodeId: "i=2253", attributeId: AttributeIds.EventNotifier }, { queueSize: 50, discardOldest: false, filter },
    TimestampsToReturn.Both,
  );
  const heard = new Promise((done, fail) => {
    setTimeout(() => fail(new Error("no event")), PATIENCE_MS).unref();
    events.on("changed", (fields) => done({ text: fields[0].value.text, severity: fields[1].value }));
  });
  console.log("subscribed");
  found.event = await heard;
  found.incident = await until("Counterflex/Alarms/Incident/Active", (seen) => seen.value === true);
  await subscription.terminate();
  await session.close();
  await client.disconnect();
  console.log(JSON.stringify(found));
}

main().then(() => process.exit(0), (fault) => { console.error(String(fault)); process.exit(1); });
